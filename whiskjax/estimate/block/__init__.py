"""Block adjustment: many images, control and tie points, one trajectory."""
