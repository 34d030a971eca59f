"""The static background in images: small features that show whether the camera has moved since its calibration."""
