#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <span>
#include <vector>

#include "recording/commit_file.h"
#include "recording/hdf5_types.h"
#include "recording/hdf5_writing.h"

/// Table of a recording, to which ticks or events are appended.
namespace palpate::internal {

/// A column and its current, partial chunk.
struct GrowingColumn {
  const Column* column;
  Handle data_set;
  std::vector<std::byte> chunk;
};

/// Columns of equal length. Complete chunks are written once; a partial one is written again, beginning with
/// the same rows, once it has more.
class GrowingTable {
 public:
  explicit GrowingTable(std::size_t chunk_rows) : chunk_rows_(chunk_rows) {}

  void add(ObjectWriter& writer, const char* group_name, std::span<const Column> columns) {
    const Handle group = writer.group(group_name);
    for (const Column& column : columns)
      columns_.push_back({&column, writer.column(group.get(), column, chunk_rows_),
                          std::vector<std::byte>(chunk_rows_ * column.row_bytes())});
  }

  /// Copies a record to the columns from `first` on; returns the index after the last one.
  std::size_t put(std::size_t first, std::span<const Column> columns, const void* record) {
    for (std::size_t c = 0; c < columns.size(); ++c)
      std::memcpy(columns_[first + c].chunk.data() + filled_ * columns[c].row_bytes(),
                  static_cast<const std::byte*>(record) + columns[c].offset, columns[c].row_bytes());
    return first + columns.size();
  }
  void next_row() { ++filled_; }

  bool full() const { return filled_ == chunk_rows_; }
  bool all_flushed() const { return filled_ == flushed_; }
  std::size_t flushed_rows() const { return start_ + flushed_; }

  /// Writes the current chunk to the end of the data sets; to be committed.
  bool flush(const CommitFile& bytes) const {
    return std::ranges::all_of(columns_, [&](const GrowingColumn& of) {
      return append_rows(of.data_set, hdf5_type(of.column->number), of.column->width, start_, filled_,
                         of.chunk.data()) &&
             bytes.error() == 0;
    });
  }
  void committed() {
    flushed_ = filled_;
    if (!full()) return;
    // start the next chunk
    start_ += chunk_rows_;
    filled_ = flushed_ = 0;
    for (GrowingColumn& column : columns_) std::ranges::fill(column.chunk, std::byte{0});
  }
  void close() { columns_.clear(); }

 private:
  std::size_t chunk_rows_;
  std::vector<GrowingColumn> columns_;
  std::size_t start_ = 0;    // rows in complete chunks
  std::size_t filled_ = 0;   // rows in the current chunk
  std::size_t flushed_ = 0;  // rows of the current chunk that are committed
};

}  // namespace palpate::internal
