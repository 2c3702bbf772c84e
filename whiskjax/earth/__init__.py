"""The Earth: WGS-84 geodesy, local frames, and surfaces that a ray can meet."""
