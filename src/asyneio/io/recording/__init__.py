"""What every format is turned into: recording contents, and the checks, sidecar files and cache around it."""
