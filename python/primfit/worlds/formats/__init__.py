"""Files of worlds: a module for each format, with `write(path, world)` and maybe `read(path)`."""
