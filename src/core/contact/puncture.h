#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "palpate/contact/proxy.h"

/// Puncture of structures by the tool, and the permanent holes that some of them keep.
namespace palpate {

/// Punctured surfaces of a layer that are still open: a surface closes when both the operator's and the
/// proxy's tool have left it. Both count because the tip may emerge from a deeper layer while the proxy is
/// still inside it.
SurfaceSet still_open(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                      const ToolPose& hand, const ProxyLayer& layer);

/// Whether a contact of the last tick was punctured; its proxy is released without a rate limit.
bool is_contact_punctured(const ProxyLayer& layer);

/// Marks a structure as punctured, and with it every surface that it is part of.
void open_structure(std::span<const ContactSurface> surfaces, int structure, ProxyState& state);

/// Spring force that acts on each structure that can be punctured, summed over layers.
class PunctureForces {
 public:
  void add(int structure, double force_N) {
    std::size_t n = 0;
    while (n < count_ && structure_[n] != structure) ++n;
    if (n == structure_.size()) return;
    if (n == count_) {
      structure_[count_++] = structure;
      force_N_[n] = 0;
    }
    force_N_[n] += force_N;
  }
  std::size_t count() const { return count_; }
  int structure(std::size_t n) const { return structure_[n]; }
  double force_N(std::size_t n) const { return force_N_[n]; }

 private:
  // capacity; structures beyond it, which do not occur in tissue, are punctured in later ticks
  static constexpr std::size_t kMost = 16;
  std::array<int, kMost> structure_;
  std::array<double, kMost> force_N_;
  std::size_t count_ = 0;
};

/// Lets the tool into permanent holes that it fits, then punctures every structure whose force exceeds its
/// puncture force. One with stays_open keeps a hole.
/// @param holes  permanent holes of all tools; null: every puncture closes
/// @return whether any structure was punctured
bool puncture(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
              const ToolPose& hand, const PunctureForces& forces, Holes* holes, ProxyState& state);

}  // namespace palpate
