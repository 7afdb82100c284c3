"""The 3-D scene: its model, the picture of one frame, and the viser nodes that draw it."""
