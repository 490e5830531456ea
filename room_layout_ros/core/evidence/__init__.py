"""Image evidence: orientation maps, geometric context, depth cues."""
