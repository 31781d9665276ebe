"""Robot programs with targets in them: one file a language; `read_program` picks it by the file's ending."""
