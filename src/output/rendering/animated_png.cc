#include "palpate/rendering/animated_png.h"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <utility>

namespace palpate {
namespace {

constexpr std::size_t kChannels = 3;
constexpr int kFilters = 5;

void append_number(std::vector<std::uint8_t>& bytes, std::uint32_t value, int size = 4) {
  for (int n = size - 1; n >= 0; --n) bytes.push_back(static_cast<std::uint8_t>(value >> (8 * n)));
}

/// Rectangle of a frame, in pixels.
struct FrameBox {
  int left = 0, top = 0, width = 0, height = 0;
};

/// Bounding box of the differences between two frames; a single pixel if there are none.
FrameBox changed_box(const Image& before, const Image& now) {
  int left = now.width, right = -1, top = now.height, bottom = -1;
  for (int row = 0; row < now.height; ++row)
    for (int column = 0; column < now.width; ++column) {
      const std::size_t at =
          kChannels * (static_cast<std::size_t>(row) * static_cast<std::size_t>(now.width) +
                       static_cast<std::size_t>(column));
      if (std::memcmp(&before.rgb[at], &now.rgb[at], kChannels) == 0) continue;
      left = std::min(left, column), right = std::max(right, column);
      top = std::min(top, row), bottom = std::max(bottom, row);
    }
  if (right < 0) return {0, 0, 1, 1};
  return {left, top, right - left + 1, bottom - top + 1};
}

std::uint8_t paeth(int left, int up, int corner) {
  const int guess = left + up - corner, a = std::abs(guess - left), b = std::abs(guess - up),
            c = std::abs(guess - corner);
  return static_cast<std::uint8_t>(a <= b && a <= c ? left : b <= c ? up : corner);
}

/// Filters each row by the PNG filter (specification, 9) with the smallest sum of bytes.
std::vector<std::uint8_t> filtered(const Image& frame, const FrameBox& box) {
  const std::size_t length = kChannels * static_cast<std::size_t>(box.width);
  const std::vector<std::uint8_t> nothing(length);
  const std::uint8_t* above = nothing.data();
  std::array<std::vector<std::uint8_t>, kFilters> tries;
  for (auto& bytes : tries) bytes.resize(length);
  std::vector<std::uint8_t> rows;
  rows.reserve((length + 1) * static_cast<std::size_t>(box.height));
  for (int row = box.top; row < box.top + box.height; ++row) {
    const std::uint8_t* here =
        &frame.rgb[kChannels * (static_cast<std::size_t>(row) * static_cast<std::size_t>(frame.width) +
                                static_cast<std::size_t>(box.left))];
    std::array<std::uint64_t, kFilters> sums{};
    for (std::size_t n = 0; n < length; ++n) {
      const int left = n >= kChannels ? here[n - kChannels] : 0, up = above[n],
                corner = n >= kChannels ? above[n - kChannels] : 0;
      const int guesses[kFilters] = {0, left, up, (left + up) / 2, paeth(left, up, corner)};
      for (std::size_t f = 0; f < kFilters; ++f) {
        tries[f][n] = static_cast<std::uint8_t>(here[n] - guesses[f]);
        sums[f] += static_cast<std::uint64_t>(std::abs(static_cast<std::int8_t>(tries[f][n])));
      }
    }
    const auto best = static_cast<std::size_t>(std::min_element(sums.begin(), sums.end()) - sums.begin());
    rows.push_back(static_cast<std::uint8_t>(best));
    rows.insert(rows.end(), tries[best].begin(), tries[best].end());
    above = here;
  }
  return rows;
}

std::vector<std::uint8_t> compressed(const std::vector<std::uint8_t>& bytes) {
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  std::vector<std::uint8_t> out(size);
  PALPATE_CHECK(compress2(out.data(), &size, bytes.data(), static_cast<uLong>(bytes.size()),
                          Z_DEFAULT_COMPRESSION) == Z_OK);
  out.resize(size);
  return out;
}

}  // namespace

AnimatedPng::AnimatedPng(int width, int height, int frames, int delay_ms)
    : width_(width), height_(height), frames_(frames), delay_ms_(delay_ms) {
  PALPATE_CHECK(width > 0 && height > 0 && frames > 0 && delay_ms > 0 && delay_ms <= 0xffff);
  bytes_ = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  std::vector<std::uint8_t> header;
  append_number(header, static_cast<std::uint32_t>(width));
  append_number(header, static_cast<std::uint32_t>(height));
  // 8-bit RGB; deflate, adaptive filters, not interlaced
  header.insert(header.end(), {8, 2, 0, 0, 0});
  chunk("IHDR", header);
  // the same colour space as in encode_png; 0: perceptual
  chunk("sRGB", {0});
  std::vector<std::uint8_t> control;
  append_number(control, static_cast<std::uint32_t>(frames));
  append_number(control, 0);  // loops forever
  chunk("acTL", control);
}

void AnimatedPng::chunk(const char* type, const std::vector<std::uint8_t>& data) {
  append_number(bytes_, static_cast<std::uint32_t>(data.size()));
  const std::size_t from = bytes_.size();
  bytes_.insert(bytes_.end(), type, type + 4);
  bytes_.insert(bytes_.end(), data.begin(), data.end());
  append_number(bytes_, static_cast<std::uint32_t>(
                            crc32(0, bytes_.data() + from, static_cast<uInt>(bytes_.size() - from))));
}

void AnimatedPng::add(Image frame) {
  PALPATE_CHECK(added_ < frames_ && frame.width == width_ && frame.height == height_);
  PALPATE_CHECK(frame.rgb.size() ==
                kChannels * static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
  // the specification requires the first frame to be the whole picture
  const FrameBox box = added_ == 0 ? FrameBox{0, 0, width_, height_} : changed_box(last_, frame);
  std::vector<std::uint8_t> control;
  append_number(control, sequence_++);
  for (const int value : {box.width, box.height, box.left, box.top})
    append_number(control, static_cast<std::uint32_t>(value));
  append_number(control, static_cast<std::uint32_t>(delay_ms_), 2);
  append_number(control, 1000, 2);
  // dispose_op 0 and blend_op 0: the box overwrites the previous frame
  append_number(control, 0, 2);
  chunk("fcTL", control);

  const std::vector<std::uint8_t> data = compressed(filtered(frame, box));
  if (added_ == 0) {
    chunk("IDAT", data);
  } else {
    std::vector<std::uint8_t> numbered;
    numbered.reserve(4 + data.size());
    append_number(numbered, sequence_++);
    numbered.insert(numbered.end(), data.begin(), data.end());
    chunk("fdAT", numbered);
  }
  last_ = std::move(frame);
  ++added_;
}

std::vector<std::uint8_t> AnimatedPng::finish() {
  PALPATE_CHECK(added_ == frames_);
  chunk("IEND", {});
  return std::move(bytes_);
}

}  // namespace palpate
