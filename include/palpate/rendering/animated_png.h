#pragma once

#include <cstdint>
#include <vector>

#include "palpate/rendering/rendering.h"

namespace palpate {

/// Makes an animated PNG (APNG, https://wiki.mozilla.org/APNG_Specification; since 2025 in the PNG
/// specification) frame by frame, of which only what is compressed is kept. It plays without end; what knows
/// no APNG shows the first frame. No text and no time: the same frames make the same bytes.
class AnimatedPng {
 public:
  /// @param frames    1 and more: so many will be added
  /// @param delay_ms  that each is shown, 1 ... 65535
  AnimatedPng(int width, int height, int frames, int delay_ms);
  /// Of the width and height; after the first one only the box is kept in which it differs from the one
  /// before.
  void add(Image frame);
  /// After the last frame.
  std::vector<std::uint8_t> finish();

 private:
  void chunk(const char* type, const std::vector<std::uint8_t>& data);

  int width_, height_, frames_, delay_ms_;
  int added_ = 0;
  std::uint32_t sequence_ = 0;
  Image last_;
  std::vector<std::uint8_t> bytes_;
};

}  // namespace palpate
