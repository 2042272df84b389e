#pragma once

#include <cstdint>
#include <vector>

#include "palpate/rendering/rendering.h"

namespace palpate {

/// Encoder for animated PNG (APNG, https://wiki.mozilla.org/APNG_Specification; since 2025 part of the PNG
/// specification) that stores frames in compressed form only. The animation loops forever; viewers without
/// APNG support show the first frame. Contains no text and no time: equal frames give equal bytes.
class AnimatedPng {
 public:
  /// @param frames    number of frames to be added, at least 1
  /// @param delay_ms  duration of each frame, 1 ... 65535
  AnimatedPng(int width, int height, int frames, int delay_ms);
  /// Adds a frame of the given width and height. After the first frame, only the bounding box of the changes
  /// is stored.
  void add(Image frame);
  /// Returns the file after the last frame.
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
