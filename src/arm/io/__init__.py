"""Files: what is read and how a wrong value is told, and how they are written so that none is half there."""
