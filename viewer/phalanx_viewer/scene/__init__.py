"""What there is to draw, what one frame looks like, and the 3-D scene that shows it."""
