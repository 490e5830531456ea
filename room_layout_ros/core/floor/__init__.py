"""The floor and what stands on it, for `freespace.py`: its plane, its cells, and what tells which of them are free."""
