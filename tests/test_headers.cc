// Belongs to the targets that precompile test_headers.h, and to no program.
