"""Models beside measurements of real robots that others have published: `rtstack campaign reality --data FOLDER`."""
