"""From the views of a camera's two lenses to the one that goes out."""
