"""What all packages use: files, records, configuration, real-time scheduling."""
