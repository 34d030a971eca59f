"""A log is read: sessions, motions, samples."""
