"""The browser of the tests, and the options that it gets."""

CHROMIUM = "/usr/bin/chromium"  # Debian's
ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--use-angle=swiftshader",
    "--disable-background-networking",
]
