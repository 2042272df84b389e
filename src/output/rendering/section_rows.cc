#include "rendering/section_rows.h"

#include <algorithm>

namespace palpate::internal::section {
namespace {

constexpr int kRowsAbove = 2;

}  // namespace

Band Pixels::sized(int width, int height) {
  // every row has padding before it, and the last one also after it
  const std::size_t stride = static_cast<std::size_t>(width) + kPixelPadding;
  const std::size_t count = stride * (kRowsAbove + kBandRows) + kPixelPadding;
  if (grey_.size() < count) {
    grey_.resize(count);
    labels_.resize(count);
  }
  if (rows_.size() < static_cast<std::size_t>(height)) rows_.resize(static_cast<std::size_t>(height));
  const std::size_t first = kPixelPadding + kRowsAbove * stride;
  return {0, 0, static_cast<std::ptrdiff_t>(stride), grey_.data() + first, labels_.data() + first};
}

bool RowCursor::next() {
  if (++y == rows_.count) return false;
  const int sampled = band_.first + band_.count;
  // outlines need the row below
  if (y + 1 >= sampled && sampled < rows_.count) sample_next_band();
  grey = grey_of(y);
  labels = labels_of(y);
  above = y > 0 ? labels_of(y - 1) : labels;
  below = y + 1 < rows_.count ? labels_of(y + 1) : labels;
  return true;
}

void RowCursor::sample_next_band() {
  const int width = rows_.width;
  const std::ptrdiff_t two_rows = kRowsAbove * band_.stride;
  if (band_.count > 0) {
    const int end = band_.first + band_.count;
    // keep the last two rows: one without the row below yet, and the one above it
    std::copy_n(labels_of(end) - two_rows - 1, two_rows, band_.labels - two_rows - 1);
    std::copy_n(grey_of(end) - two_rows, two_rows, band_.grey - two_rows);
  }
  band_.first += band_.count;
  band_.count = std::min(kBandRows, rows_.count - band_.first);
  sample(volume_, scale_, rows_, band_);

  const bool has_scan = volume_.scan != nullptr || volume_.codes != nullptr,
             has_labels = volume_.labels != nullptr || volume_.numbers != nullptr;
  for (int row = band_.first; row < band_.first + band_.count; ++row) {
    // fill pixels outside the volume
    const auto fill = [&, inside = rows_.row[row]](bool sampled, auto* to, auto value) {
      std::fill(to, sampled ? to + inside.begin : to + width, value);
      if (sampled) std::fill(to + inside.end, to + width, value);
    };
    fill(has_scan, grey_of(row), background_);
    LabelId* to = labels_of(row);
    fill(has_labels, to, LabelId{0});
    for (; !moved_.empty() && moved_.front().row == row; moved_ = moved_.subspan(1))
      sample_at_rest(moved_.front());
    // repeat the end labels, so that no outline appears at the picture's border
    to[-1] = to[0];
    to[width] = to[width - 1];
  }
}

// samples a one-pixel picture, since the kernel writes whole vectors
void RowCursor::sample_at_rest(const DisplacedPixel& moved) {
  alignas(64) std::uint8_t some_grey[3 * kPixelPadding]{};
  alignas(64) LabelId some_labels[3 * kPixelPadding]{};
  const Band one{0, 1, kPixelPadding, some_grey + kPixelPadding, some_labels + kPixelPadding};
  *one.grey = background_;
  sample(volume_, scale_, {&moved.at_rest, 1, 1, {}}, one);
  grey_of(moved.row)[moved.column] = *one.grey;
  labels_of(moved.row)[moved.column] = *one.labels;
}

}  // namespace palpate::internal::section
