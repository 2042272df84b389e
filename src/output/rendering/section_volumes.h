#pragma once

#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "palpate/rendering/rendering.h"
#include "rendering/section_simd.h"

namespace palpate::internal::section {

/// Allocates memory in huge pages if available, for sizes above one of them; always cache-line aligned. With
/// small pages, a plane through the volume would exceed the TLB.
void* allocate_huge_pages(std::size_t bytes);
void free_huge_pages(void* memory, std::size_t bytes) noexcept;
template <class T>
struct HugePageAllocator {
  using value_type = T;
  HugePageAllocator() = default;
  template <class U>
  HugePageAllocator(const HugePageAllocator<U>&) {}
  T* allocate(std::size_t count) { return static_cast<T*>(allocate_huge_pages(count * sizeof(T))); }
  void deallocate(T* memory, std::size_t count) noexcept { free_huge_pages(memory, count * sizeof(T)); }
  bool operator==(const HugePageAllocator&) const = default;
};
template <class T>
using HugePageVector = std::vector<T, HugePageAllocator<T>>;

/// A model's scan and labels in the layout for sections, in the model or in bricks. Immutable.
class Volumes {
 public:
  Volumes(const Model& model, SectionStorage storage);

  bool empty() const { return scan_ == nullptr && labels_ == nullptr; }
  bool has_scan() const { return scan_ != nullptr; }
  const GridGeometry& grid() const { return scan_ != nullptr ? scan_->geometry() : labels_->geometry(); }
  /// scan_window(), computed once; {0, 1} without a scan.
  std::array<double, 2> automatic_window() const;
  const VolumeView& view() const { return view_; }
  std::size_t prepared_bytes() const;

  /// Mapping of stored scan values to grey.
  GreyScale grey_scale(const std::array<double, 2>& window, int levels) const;

 private:
  void make_scan_bricks();
  void make_label_bricks();

  std::shared_ptr<const Volume<float>> scan_;
  std::shared_ptr<const Bricks<LabelId>> labels_;
  Volume<LabelId> plain_labels_;  ///< Used without bricks
  HugePageVector<std::uint16_t> codes_;
  HugePageVector<LabelId> brick_labels_;
  HugePageVector<std::uint8_t> numbers_;  ///< Used instead of brick_labels_ if labels fit in a byte
  std::vector<LabelId> label_of_number_;
  double code_zero_ = 0, per_value_ = 1;  ///< code = (value - code_zero_) * per_value_
  VolumeView view_;
  mutable std::once_flag window_known_;
  mutable std::array<double, 2> window_{0, 1};
};

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
