"""From a video or photos to posed, undistorted, metric images."""
