#pragma once

#include <array>
#include <cstddef>
#include <span>

#include "palpate/contact/proxy.h"

/// Puncture of structures by the tool, and permanent holes in structures with stays_open.
namespace palpate {

/// Punctured surfaces of a layer that are still open. A surface closes when the tool is farther than
/// ProxySettings::closing_mm from it both in the operator's pose and in the proxy's: a tip may have emerged
/// from the surface while its proxy is still inside.
SurfaceSet still_open(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                      const ToolPose& tool_pose, const ProxyLayer& layer);

/// Whether the surface of any contact of the last tick was punctured, so that the proxy is released without a
/// rate limit.
bool is_contact_punctured(const ProxyLayer& layer);

/// Marks every surface that belongs to a structure, or is opened by its puncture, as punctured.
void open_structure(std::span<const ContactSurface> surfaces, int structure, ProxyState& state);

/// Spring force that acts on each structure that can be punctured, summed over layers.
class PunctureForces {
 public:
  /// Adds to the force on a structure; ignored if the capacity is used up.
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
  // Capacity, more than the number of puncturable structures that a tool touches at once. A structure beyond
  // it is punctured in a later tick, when others are no longer in contact.
  static constexpr std::size_t kCapacity = 16;
  std::array<int, kCapacity> structure_;
  std::array<double, kCapacity> force_N_;
  std::size_t count_ = 0;
};

/// Opens structures at permanent holes that the tool fits, then punctures every structure on which the spring
/// force exceeds puncture_N. A punctured structure with stays_open keeps a permanent hole.
/// @param holes  permanent holes of all tools; null: every puncture closes
/// @return whether any structure was punctured
bool puncture(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
              const ToolPose& tool_pose, const PunctureForces& forces, Holes* holes, ProxyState& state);

}  // namespace palpate
