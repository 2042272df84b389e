#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "palpate/server/viewer_host.h"

namespace palpate::server {

/// Binary message with the deformation around a device's tool, in the layout of
/// docs/reference/viewer-messages.md: the bounding box of the displaced nodes, quantised to integer steps.
class DeformationMessage {
 public:
  static constexpr std::size_t kHead_bytes = 96;
  /// Limits of a grid, per axis and in total; larger grids are not sent.
  static constexpr int kMaxNodes_axis = 64;
  static constexpr std::size_t kMaxNodes = 32768;
  /// Displacement below which a node counts as at rest; not visible.
  static constexpr float kMin_mm = 0.005f;
  /// Quantisation step. Fine, because strain is computed from differences.
  static constexpr float kStep_mm = 0.001f;

  /// @param deformation  null: no deformation; equivalent to a field none of whose nodes has to be sent
  DeformationMessage(std::size_t device, const ViewedDeformation* deformation);

  /// Whether there is no deformation.
  bool rests() const { return steps_.empty(); }
  /// Whether the two messages are visually indistinguishable.
  bool is_indistinguishable_from(const DeformationMessage& other) const;
  std::string bytes() const;

 private:
  bool take(const ViewedDeformation& deformation);

  std::uint16_t device_;
  std::uint32_t frame_ = 0;
  std::array<int, 3> nodes_{};
  std::array<double, 3> first_mm_{};
  std::array<double, 9> axes_{};
  double spacing_mm_ = 0;
  float step_mm_ = kStep_mm;
  std::array<int, 3> lo_{}, size_{};
  std::vector<std::int16_t> steps_;  ///< Displacements in the box: x, y, z; i fastest
};

/// Latest deformation message of one device, shared by the viewers.
struct PublishedDeformation {
  std::uint64_t number = 0;  ///< Changes with each message; 0: none yet
  bool rests = true;
  std::shared_ptr<const std::string> bytes;
};

}  // namespace palpate::server
