"""The network that looks at the whole picture: its layers and their kernels."""
