#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "rendering/section_simd.h"

namespace palpate::internal::section {

/// Pixel of displaced tissue, with a one-pixel row at its rest position; empty if that is outside the volume.
struct DisplacedPixel {
  int row = 0, column = 0;
  Row at_rest;
};

/// Buffers for a picture's rows, and for the greys and labels of a band and the two rows above it.
class Pixels {
 public:
  /// Grows the buffers if necessary. The band begins below the two rows.
  Band sized(int width, int height);
  std::vector<Row>& rows() { return rows_; }
  std::vector<DisplacedPixel>& moved() { return moved_; }

 private:
  std::vector<std::uint8_t> grey_;
  std::vector<LabelId> labels_;
  std::vector<Row> rows_;
  std::vector<DisplacedPixel> moved_;
};

/// Iterates over a picture row by row, from the top: `while (next())`. A band of rows is sampled when its
/// first row is reached, over the previous band, so that the data stay in the cache.
class RowCursor {
 public:
  /// @param volume  without the layers that are not needed
  /// @param moved   sorted by rows, then by columns
  RowCursor(const VolumeView& volume, const GreyScale& scale, const Rows& rows, std::uint8_t background,
            const Band& band, std::span<const DisplacedPixel> moved)
      : volume_(volume), scale_(scale), rows_(rows), background_(background), band_(band), moved_(moved) {}
  bool next();

  int y = -1;
  const std::uint8_t* grey = nullptr;
  const LabelId* labels = nullptr;  ///< Readable one beyond either end, where it repeats the end
  const LabelId* above = nullptr;   ///< The row itself at the border
  const LabelId* below = nullptr;

 private:
  void sample_next_band();
  void sample_at_rest(const DisplacedPixel& moved);
  // for sampled rows and the two above them
  LabelId* labels_of(int row) const { return band_.labels + (row - band_.first) * band_.stride; }
  std::uint8_t* grey_of(int row) const { return band_.grey + (row - band_.first) * band_.stride; }

  VolumeView volume_;
  GreyScale scale_;
  Rows rows_;
  std::uint8_t background_;
  Band band_;
  std::span<const DisplacedPixel> moved_;  ///< Remaining ones
};

}  // namespace palpate::internal::section
