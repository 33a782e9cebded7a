"""The gateway: the process that owns every browser's connection and keeps it while cores come and go."""
