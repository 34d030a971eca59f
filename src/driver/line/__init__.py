"""The serial line to the controller: protocol, port, clock, echo, and the log of every byte."""
