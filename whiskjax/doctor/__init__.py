"""The doctor: what people get wrong about a flight, tried one by one, and which of it explains the data."""
