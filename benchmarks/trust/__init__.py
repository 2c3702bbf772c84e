"""The trust bench: ways to be wrong, with the truth known, that measure whether a verdict can be fooled."""
