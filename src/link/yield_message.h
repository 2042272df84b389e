#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "palpate/link/viewer_server.h"

namespace palpate::link {

/// How tissue has yielded around a device's tool as viewers get it, in the layout of
/// docs/reference/viewer-messages.md: of the grid's nodes the smallest box around those that moved, in whole
/// steps.
class YieldMessage {
 public:
  static constexpr std::size_t kHead_bytes = 96;
  /// A grid with more nodes along an axis or altogether is not told.
  static constexpr int kMostNodes_axis = 64;
  static constexpr std::size_t kMostNodes = 32768;
  /// What is moved by less is not seen: such nodes are at rest.
  static constexpr float kLeast_mm = 0.005f;
  /// As fine as that: what is strained is computed from differences.
  static constexpr float kStep_mm = 0.001f;

  /// @param yield  null: nothing has yielded any more, and neither has where none of its nodes is told
  YieldMessage(std::size_t device, const ViewedYield* yield);

  /// Nothing has yielded.
  bool rests() const { return steps_.empty(); }
  /// Whether a viewer that has the other one sees anything else with this one.
  bool looks_like(const YieldMessage& other) const;
  std::string bytes() const;

 private:
  bool take(const ViewedYield& yield);

  std::uint16_t device_;
  std::uint32_t frame_ = 0;
  std::array<int, 3> nodes_{};
  std::array<double, 3> first_mm_{};
  std::array<double, 9> axes_{};
  double spacing_mm_ = 0;
  float step_mm_ = kStep_mm;
  std::array<int, 3> lo_{}, size_{};
  std::vector<std::int16_t> steps_;  ///< of the box: x, y, z, i fastest
};

/// What the hub knows of the tissue around one device: the newest message, which viewers share.
struct ToldYield {
  std::uint64_t number = 0;  ///< another one: another message; 0: there was none
  bool rests = true;
  std::shared_ptr<const std::string> bytes;
};

}  // namespace palpate::link
