"""The images that are used: of a video, sharp and spread over the way; of a folder, turned upright."""
