#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "palpate/rendering.h"
#include "rendering/section_simd.h"

namespace palpate::internal::section {

/// A model's scan and labels as sections read them, in the model or in bricks. Immutable.
class Volumes {
 public:
  Volumes(const Model& model, SectionStorage storage);

  bool empty() const { return scan_ == nullptr && labels_ == nullptr; }
  bool has_scan() const { return scan_ != nullptr; }
  const GridGeometry& grid() const { return scan_ != nullptr ? scan_->geometry() : labels_->geometry(); }
  /// scan_window(), found once; {0, 1} without a scan.
  std::array<double, 2> automatic_window() const;
  const VolumeView& view() const { return view_; }
  std::size_t prepared_bytes() const;

  /// From what the scan is read as to grey.
  GreyScale grey_scale(const std::array<double, 2>& window, int levels) const;

 private:
  void make_scan_bricks();
  void make_label_bricks();

  std::shared_ptr<const Volume<float>> scan_;
  std::shared_ptr<const Volume<LabelId>> labels_;
  std::vector<std::uint16_t> codes_;
  std::vector<LabelId> brick_labels_;
  std::vector<std::uint8_t> numbers_;  ///< instead of them
  std::vector<LabelId> label_of_number_;
  double code_zero_ = 0, per_value_ = 1;  ///< code = (value - code_zero_) * per_value_
  VolumeView view_;
  mutable std::once_flag window_known_;
  mutable std::array<double, 2> window_{0, 1};
};

/// Room for one picture's greys and labels, and its rows.
class Pixels {
 public:
  /// Grows where it has to.
  PixelView sized(int width, int height);
  std::vector<Row>& rows() { return rows_; }

 private:
  std::vector<std::uint8_t> grey_;
  std::vector<LabelId> labels_;
  std::vector<Row> rows_;
};

}  // namespace palpate::internal::section
