"""What both sides know of images: georeferenced maps and heights. Not part of the core."""
