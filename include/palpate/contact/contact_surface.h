#pragma once

#include <array>
#include <bitset>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "palpate/contact/contact_settings.h"
#include "palpate/contact/owners.h"
#include "palpate/contact/soft_contact.h"
#include "palpate/sampling/surface.h"

/// Surfaces of a model as the proxy touches them, and the structures that own their points.
namespace palpate {

/// A surface with its contact properties: the surface of one structure, or a common surface of structures
/// that touch. Touching structures share a surface because two separate surfaces side by side are both
/// rounded at the seam and a tool would fall into the crack between them.
///
/// Structures that are stiffer than their surroundings form layers. Where fat and bone touch, the outer layer
/// is their common surface, with the stiffness of fat; the surface of bone lies in the next layer, with the
/// difference between the stiffness of bone and that of fat. Each layer constrains its own proxy, so the
/// total force is the stiffness integrated along the penetration path, as in the inward ramp
/// (docs/decisions/archive/0011-inward-ramps.md), and each layer's force is that of a conservative spring.
///
/// For a deformable structure the contact force at a depth is computed from the elastic solution
/// (soft_contact.h) instead of from a spring stiffness. A deformable structure belongs to the outermost of
/// the layers that it touches; rigid structures within keep their whole stiffness.
struct ContactSurface : ContactProperties {
  /// Signed-distance surface. null: the structure has no surface of its own and is in contact only through
  /// common surfaces.
  std::shared_ptr<const Surface> surface;
  /// Normal force above which the tool punctures the structure; infinite: never.
  double puncture_N = std::numeric_limits<double>::infinity();
  bool stays_open = false;  ///< Whether a puncture leaves a permanent hole (holes.h)
  /// Ownership of a common surface: contact properties there are averaged over the owning structures by their
  /// shares and replace the values above. null: not a common surface.
  std::shared_ptr<const Owners> owners = nullptr;
  /// Index of the structure to which this additional surface belongs, in a layer outside that structure's
  /// own. -1: the entry is a structure's own, or a common surface.
  int structure = -1;
  /// Index of the common surface that covers this one; this surface is only tested for contact while the tool
  /// has punctured that one. -1: not covered.
  int covered_by = -1;
  /// Indices of the structures whose puncture also opens this common surface.
  std::vector<std::int16_t> opened_by = {};
  /// Layer index, 0 is the outermost. The entry of a structure has the innermost layer that contributes to
  /// its stiffness.
  int layer = 0;
  /// Stiffness interval contributed by this layer, N/mm. In a structure's own layer the interval has no upper
  /// bound: the contribution is all stiffness above lower_N_per_mm.
  double lower_N_per_mm = 0, upper_N_per_mm = std::numeric_limits<double>::infinity();
  /// Specific cutting energy: work of a burr's motor per volume removed (palpate/tissue/removal.h). Infinite:
  /// a burr cannot cut it.
  double cutting_energy_mJ_per_mm3 = std::numeric_limits<double>::infinity();
  /// Surface before any tissue was removed (palpate/tissue/carving.h), and the labels from which it was
  /// built; null if nothing was removed. Points below that surface are owned according to these labels.
  std::shared_ptr<const Surface> original_surface = nullptr;
  std::shared_ptr<const Bricks<LabelId>> original_labels = nullptr;
  /// Whether burrs are blocked from removing this structure (palpate/tissue/removal.h).
  bool is_protected = false;
  /// Maximum amount by which Surface::distance_mm() underestimates the distance to a carved part of the
  /// surface (CarvedSurface::clearance_error_mm).
  double clearance_error_mm = 0;
  /// Plane-strain modulus E / (1 - nu^2) of a deformable structure. 0: not deformable, a spring.
  double plane_strain_modulus_N_per_mm2 = 0;
  /// Exponent of a deformable structure's strain stiffening (ElasticConstants::stiffening). 0: none.
  double strain_stiffening = 0;
  /// Relaxation fractions of a deformable structure, one per time constant of the model.
  RelaxationFractions relaxed = {};
};
/// A touchable structure that a burr should spare.
struct ProtectedStructure {
  LabelId label = 0;
  std::shared_ptr<const Surface> surface;  ///< The structure's own surface before any removal
  bool is_protected = false;               ///< Whether burrs are blocked from removing it
};
/// Ownership of a surface point: on a common surface the shares of its structures at that point, otherwise
/// the one structure with share 1.
/// @param index  index into `surfaces`
OwnerFractions owners_at(std::span<const ContactSurface> surfaces, int index, const Point<Patient>& at);
/// Cache of the last four owner lookups. A tool at rest on a few contacts looks up the same points in every
/// tick.
class OwnerCache {
 public:
  /// Result of owners_at(), taken from the cache if available.
  OwnerFractions at(std::span<const ContactSurface> surfaces, int index, const Point<Patient>& position);

 private:
  struct Entry {
    std::uint64_t owners = 0;  ///< Owners::id(). 0: empty entry
    int surface = -1;
    /// Whether tissue had been removed from the surface; the original surface and labels do not change
    /// afterwards.
    bool cut = false;
    Point<Patient> position;
    OwnerFractions fractions;
  };
  std::array<Entry, 4> entries_;
  std::size_t next_ = 0;
};
/// Maximum number of surfaces of a model.
inline constexpr std::size_t kMaxSurfaces = 1024;
/// Set of surfaces, by their index.
using SurfaceSet = std::bitset<kMaxSurfaces>;

}  // namespace palpate
