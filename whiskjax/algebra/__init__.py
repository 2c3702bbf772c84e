"""Vectors, matrices and angles as components: elementwise over any batch shape, structural zeros folded."""
