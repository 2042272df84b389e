#pragma once

#include "recording/commit_file.h"
#include "recording/hdf5_handle.h"

namespace palpate::internal {

/// File access properties with which HDF5 does its input and output through `file`, which must outlive
/// the HDF5 file. A failed handle when HDF5 has no memory left.
Handle access_through(CommitFile& file);

/// Flushes HDF5's caches and commits. False when a write failed; CommitFile::error() tells why.
bool commit(const Handle& hdf5_file, CommitFile& file);

}  // namespace palpate::internal
