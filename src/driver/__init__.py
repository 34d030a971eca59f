"""Plan in, bytes out: the MARS-8 protocol, streaming, monitoring, and an emulated controller."""
