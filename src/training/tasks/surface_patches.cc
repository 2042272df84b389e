#include <algorithm>
#include <cstdint>

#include "palpate/tasks/task.h"

namespace palpate {
namespace {

constexpr double kBoundary = 1 << 20;  // limit of cube indices per axis, far beyond any patient

std::uint64_t key_of(const Eigen::Vector3d& cube) {
  const auto part = [](double v) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::clamp(v, -kBoundary, kBoundary - 1)) +
                                      static_cast<std::int64_t>(kBoundary));
  };
  return part(cube[0]) | part(cube[1]) << 21 | part(cube[2]) << 42;
}

}  // namespace

void SurfacePatches::add(const Eigen::Vector3d& position_mm) {
  const Eigen::Vector3d cube = (position_mm / kEdge_mm).array().floor();
  if (at_.emplace(key_of(cube), static_cast<std::uint32_t>(covered_.size())).second)
    covered_.push_back(false);
}

void SurfacePatches::cover(const Eigen::Vector3d& contact_mm) {
  const Eigen::Vector3d first = ((contact_mm.array() - kWithin_mm) / kEdge_mm).floor();
  const Eigen::Vector3d last = ((contact_mm.array() + kWithin_mm) / kEdge_mm).floor();
  Eigen::Vector3d cube;
  for (cube[2] = first[2]; cube[2] <= last[2]; ++cube[2]) {
    for (cube[1] = first[1]; cube[1] <= last[1]; ++cube[1]) {
      for (cube[0] = first[0]; cube[0] <= last[0]; ++cube[0]) {
        const Eigen::Vector3d low = cube * kEdge_mm;
        const Eigen::Vector3d nearest = contact_mm.cwiseMax(low).cwiseMin((low.array() + kEdge_mm).matrix());
        if ((nearest - contact_mm).squaredNorm() > kWithin_mm * kWithin_mm) continue;
        const auto found = at_.find(key_of(cube));
        if (found == at_.end() || covered_[found->second]) continue;
        covered_[found->second] = true;
        ++covered_count_;
      }
    }
  }
}

std::vector<SurfacePatches::Patch> SurfacePatches::all() const {
  std::vector<Patch> patches(covered_.size());
  constexpr std::uint64_t kPart = (1u << 21) - 1;
  for (const auto& [key, place] : at_) {
    const auto part = [key = key](int shift) {
      return static_cast<double>(key >> shift & kPart) - kBoundary;
    };
    patches[place] = {(Eigen::Vector3d(part(0), part(21), part(42)).array() + 0.5) * kEdge_mm,
                      covered_[place]};
  }
  return patches;
}

}  // namespace palpate
