"""A robot looks into a room once and knows the room: layout and clutter from one RGB-D frame."""

__version__ = "0.1.0"
