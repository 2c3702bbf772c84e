"""Speed of whiskjax as ratios to other programs on the same core: `python -m benchmarks [NAME ...] [--gate] [--update]`."""
