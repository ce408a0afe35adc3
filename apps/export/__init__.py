"""Export of recorded data to the formats of other frameworks; an interrupted export resumes."""
