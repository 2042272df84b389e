#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "palpate/rendering/rendering.h"
#include "rendering/huge_pages.h"
#include "rendering/section_simd.h"

namespace palpate::internal::section {

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

}  // namespace palpate::internal::section
