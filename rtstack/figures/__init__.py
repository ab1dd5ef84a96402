"""Figures of logs and campaigns, in one style: what `rtstack plot`, the page's export and the papers draw with."""
