"""Flights that nobody here made: converters to flight folders, and the figures that whiskjax reaches on them."""
