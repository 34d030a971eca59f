"""Read a wire log: sessions, motions, samples."""
