#pragma once

#include "recording/commit_file.h"
#include "recording/hdf5_handle.h"

namespace palpate::internal {

/// File access property list by which HDF5 performs its input and output through `file`, which must outlive
/// the HDF5 file. Returns an invalid handle if HDF5 is out of memory.
Handle access_through(CommitFile& file);

/// Flushes HDF5's caches and commits. False if a write failed; see CommitFile::error().
bool commit(const Handle& hdf5_file, CommitFile& file);

}  // namespace palpate::internal
