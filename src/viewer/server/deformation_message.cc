#include "server/deformation_message.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "palpate/base/check.h"
#include "server/pose_message.h"
#include "server/wire_writer.h"

namespace palpate::server {
namespace {

// two steps: below the jitter of the solution under a hand at rest
constexpr int kSameSteps = 2;

// whether the grid is valid and has a displacement per node
bool is_grid(const ViewedDeformation& deformation) {
  std::size_t nodes = 1;
  for (const int along : deformation.nodes) {
    if (along < 2 || along > DeformationMessage::kMaxNodes_axis) return false;
    nodes *= static_cast<std::size_t>(along);
  }
  const auto finite = [](double value) { return std::isfinite(value); };
  return nodes <= DeformationMessage::kMaxNodes && deformation.moved_mm.size() == 3 * nodes &&
         std::all_of(deformation.moved_mm.begin(), deformation.moved_mm.end(), finite) &&
         std::all_of(deformation.first_patient_mm.begin(), deformation.first_patient_mm.end(), finite) &&
         std::all_of(deformation.axes.begin(), deformation.axes.end(), finite) &&
         finite(deformation.spacing_mm) && deformation.spacing_mm > 0;
}

}  // namespace

DeformationMessage::DeformationMessage(std::size_t device, const ViewedDeformation* deformation)
    : device_(static_cast<std::uint16_t>(device)) {
  if (deformation == nullptr) return;
  frame_ = deformation->frame;
  if (!is_grid(*deformation) || !take(*deformation)) return;
  nodes_ = deformation->nodes;
  first_mm_ = deformation->first_patient_mm;
  axes_ = deformation->axes;
  spacing_mm_ = deformation->spacing_mm;
}

// returns false if no node has to be sent
bool DeformationMessage::take(const ViewedDeformation& deformation) {
  const int width = deformation.nodes[0], height = deformation.nodes[1], depth = deformation.nodes[2];
  const auto at = [&](int i, int j, int k) {
    return &deformation.moved_mm[3 * (static_cast<std::size_t>(i) +
                                      static_cast<std::size_t>(width) *
                                          (static_cast<std::size_t>(j) +
                                           static_cast<std::size_t>(height) * static_cast<std::size_t>(k)))];
  };
  std::array<int, 3> lo{width, height, depth}, hi{-1, -1, -1};
  float max_mm = 0;
  for (int k = 0; k < depth; ++k)
    for (int j = 0; j < height; ++j)
      for (int i = 0; i < width; ++i) {
        const float* moved = at(i, j, k);
        const float far_mm = std::max({std::abs(moved[0]), std::abs(moved[1]), std::abs(moved[2])});
        if (far_mm < kMin_mm) continue;
        max_mm = std::max(max_mm, far_mm);
        const std::array<int, 3> node{i, j, k};
        for (std::size_t axis = 0; axis < 3; ++axis) {
          lo[axis] = std::min(lo[axis], node[axis]);
          hi[axis] = std::max(hi[axis], node[axis]);
        }
      }
  if (hi[0] < 0) return false;
  constexpr float kMaxSteps = std::numeric_limits<std::int16_t>::max();
  step_mm_ = std::max(kStep_mm, max_mm / kMaxSteps);
  lo_ = lo;
  for (std::size_t axis = 0; axis < 3; ++axis) size_[axis] = hi[axis] - lo[axis] + 1;
  for (int k = lo[2]; k <= hi[2]; ++k)
    for (int j = lo[1]; j <= hi[1]; ++j)
      for (int i = lo[0]; i <= hi[0]; ++i)
        for (int c = 0; c < 3; ++c)
          steps_.push_back(static_cast<std::int16_t>(
              std::lround(std::clamp(at(i, j, k)[c] / step_mm_, -kMaxSteps, kMaxSteps))));
  return true;
}

bool DeformationMessage::is_indistinguishable_from(const DeformationMessage& other) const {
  if (rests() && other.rests()) return true;
  return nodes_ == other.nodes_ && first_mm_ == other.first_mm_ && axes_ == other.axes_ &&
         spacing_mm_ == other.spacing_mm_ && step_mm_ == other.step_mm_ && lo_ == other.lo_ &&
         size_ == other.size_ &&
         std::equal(steps_.begin(), steps_.end(), other.steps_.begin(), other.steps_.end(),
                    [](int one, int another) { return std::abs(one - another) <= kSameSteps; });
}

std::string DeformationMessage::bytes() const {
  std::string bytes(kHead_bytes + 2 * steps_.size(), '\0');
  WireWriter out(bytes.data());
  for (const char c : std::string_view("PLPY")) out.unsigned_integer(static_cast<std::uint8_t>(c));
  out.unsigned_integer(static_cast<std::uint16_t>(kProtocolVersion));
  out.unsigned_integer(device_);
  out.unsigned_integer(static_cast<std::uint32_t>(bytes.size()));
  out.unsigned_integer(frame_);
  for (const auto& three : {nodes_, lo_, size_})
    for (const int count : three) out.unsigned_integer(static_cast<std::uint16_t>(count));
  out.unsigned_integer(std::uint16_t{0});
  out.reals32(first_mm_);
  // columns of the matrix are axes
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (std::size_t row = 0; row < 3; ++row) out.real32(axes_[3 * row + axis]);
  out.real32(spacing_mm_);
  out.real32(step_mm_);
  out.unsigned_integer(std::uint32_t{0});
  PALPATE_CHECK(out.at() == bytes.data() + kHead_bytes);
  for (const std::int16_t step : steps_) out.unsigned_integer(static_cast<std::uint16_t>(step));
  return bytes;
}

}  // namespace palpate::server
