"""Campaigns from the page: `rtstack campaign` as a child process of the console, and what its folder says of it."""
