"""What `rtstack --help` lists: names, options and help. Each imports what it needs when it runs."""
