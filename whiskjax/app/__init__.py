"""The command line: one file a verb; it reads, calls the library, prints, writes, and says by its exit code how it ended."""
