#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "palpate/contact/proxy.h"
#include "palpate/tissue/carving.h"

/// Removal of bone by a burr, rendered in the tick in which the burr cuts. Positions are in the patient
/// frame.
namespace palpate {

/// A rotating head: a ball, or a row of balls along the spindle that forms a cylinder or cone with round ends
/// (Sweep). The first ball's centre is at the tip.
struct Burr {
  double radius_mm = 1.5;  ///< Radius of the first ball; for a ball, half of the size stated by its vendor
  double revolutions_per_s = 0;
  /// Unit vector of the spindle at the tool's current attitude. Edges near the axis move slowly and cut
  /// little.
  Vector<Patient> axis = {0, 0, 1};
  /// Ratio of the cutting edges' tangential to normal force (a coefficient of friction).
  double grip = 0.5;
  /// Upper bound of the press force: the maximum force of the device.
  double max_press_N = std::numeric_limits<double>::infinity();
  /// Protected structures; the head stays out of those with ProtectedStructure::is_protected.
  std::span<const ProtectedStructure> protected_structures = {};
  std::uint32_t stroke = 0;  ///< Stroke number of its sweeps
  /// Model whose surfaces are cut; its voxels measure thin bone (Model::thin_voxels). null: only surfaces
  /// count.
  const Model* model = nullptr;
  double length_mm = 0;  ///< Distance from the first ball's centre to the last one's, along `axis`; 0: a ball
  double end_radius_mm = 0;  ///< Radius of the last ball, above 0; unused for a ball

  /// Head as a part of the tool, with all radii reduced by `inset_mm`, at the hand's attitude.
  ToolPart head(double inset_mm) const;
  double min_radius_mm() const;
  double max_radius_mm() const;
};

/// Maximum number of sweeps that are not carved yet.
inline constexpr int kMaxSweeps = 64;

/// State of a burr between two ticks, including sweeps that are not yet carved from the surfaces. Contains no
/// pointers.
struct BurrState {
  /// Reduction of the collision radii: how deep the burr has cut since the surfaces were last rebuilt.
  double inset_mm = 0;
  double penetration_mm = 0;     ///< Actual depth of the head in the surfaces, at most inset_mm
  double unspent_work_mJ = 0;    ///< Motor work that has not been spent on material yet
  double pressed_N = 0;          ///< Press force of the hand in the last tick
  double edge_speed_mm_s = 0;    ///< Mean speed of the cutting edges in the material in the last tick
  double front_mm2 = 0;          ///< Area of the material ahead, projected along the press direction
  double energy_mJ_per_mm3 = 0;  ///< Mean specific cutting energy of that material
  double work_mJ = 0;            ///< Motor work since the start
  double removed_mm3 = 0;        ///< Volume removed since the start, by the energy balance
  int layer = -1;                ///< Layer of the proxy in which it cuts; -1: none
  bool sweep_closed = false;  ///< Whether the last sweep is complete and must not be extended, e.g. because
                              ///< the motor is off
  Vector<Patient> sweep_start_axis_mm;  ///< Axis of the head at the start of the last sweep
  double sweep_age_s = 0;               ///< Time since the last sweep began
  /// No capacity for more sweeps: the burr does not cut until the surfaces are rebuilt.
  bool sweeps_full = false;
  std::uint64_t first_sweep = 0;  ///< Number of the first sweep stored here, counted from the start
  int sweep_count = 0;            ///< Number of pending sweeps
  std::array<Sweep, kMaxSweeps> sweep;
  /// Motor work spent on each pending sweep, by bone class.
  std::array<std::array<double, kBoneClasses>, kMaxSweeps> spent_mJ{};
  /// Energy account: material removed up to the last settlement (settle_burr()); cutting energy not covered
  /// by motor work and not charged yet, negative for a credit; the debt, which the motor must work off before
  /// the burr advances; and the specific cutting energy of the material that caused the debt.
  CarvedMaterial settled;
  std::array<double, kBoneClasses> balance_mJ{};
  double debt_mJ = 0, debt_mJ_per_mm3 = 0;
  std::uint64_t thin_ticks = 0;  ///< Number of ticks in which thin bone was measured

  std::span<const Sweep> pending() const { return {sweep.data(), static_cast<std::size_t>(sweep_count)}; }
};

/// Advances a burr by one tick: it removes material, then the proxy advances to the position allowed with the
/// burr as its tool.
///
///  power        P = grip * force * speed of the edges              (Arbabtafti et al. 2011: the specific
///  rate         volume per s = P / energy                           cutting energy is the material's own)
///  feed         rate / area of the material ahead, along the press direction
///
/// The burr's collision radii are reduced by the feed until surfaces without the removed material have been
/// built (CarvedSurface). Everything that the head sweeps is removed, and it moves through material only as
/// far as the motor's work allows, in any direction and by any rotation. The removed volume therefore follows
/// from work alone, at any tick rate, and rebuilt surfaces, which are interpolated between voxels, move the
/// burr no faster than it cuts.
///
/// Area and speed are averaged over directions ahead in which material is directly in front of the burr; for
/// a cylinder or cone, over its round ends and its lateral surface. While the axis rotates, its ends move by
/// different distances; each direction's share of the area is then reduced to the ratio of the local
/// displacement to that of the faster end, so that area times the faster end's displacement is the swept
/// volume. At 0 revolutions the tool cuts
/// nothing. It cuts in the innermost layer in contact; softer layers around it are displaced.
///
/// No layer's proxy moves any part of the head, with its full radius, deeper into a protected structure than
/// it was: the head slides along that structure's prepared surface. Protected structures do not count as
/// material ahead. Bounded work; does not allocate, lock or throw.
/// @param tool_pose  pose to whose attitude `burr.axis` belongs
ProxyResult advance_burr(std::span<const ContactSurface> surfaces, const Burr& burr,
                         const ToolPose& tool_pose, ProxyState& proxy, BurrState& state,
                         const ProxyOptions& options = {});

/// Adapts the state to rebuilt surfaces, from which the first `carved` sweeps (counted from the start) have
/// been removed. Must be called before transfer_proxy. If an undo has restored material around the burr, the
/// overlap counts as inset, so that the force does not jump. If the overlap reaches the least radius, as when
/// a ball's centre is inside the material, transfer_proxy drops the proxy and the force fades out.
/// @param tool_pose  pose to whose attitude `burr.axis` belongs
void rebase_burr(std::span<const ContactSurface> surfaces, const Burr& burr, const ToolPose& tool_pose,
                 std::uint64_t carved, const ProxyState& proxy, BurrState& state);

/// Settles the energy account for sweeps that have been carved: the excess of the removed material's cutting
/// energy over the work spent becomes a debt, which the motor works off before the burr advances. Overlaps
/// and protected voxels cost nothing. In bone thick enough for its surface the difference is within the
/// tolerance of the account (CuttingSettings), and nothing is charged. Must be called before rebase_burr.
/// @param carved  material removed by the burr since the start
void settle_burr(const CarvedMaterial& carved, BurrState& state);

/// Number of complete sweeps since the start; these can be carved from a surface.
std::uint64_t finished_sweeps(const BurrState& state);
/// Complete sweeps from `number` on, which must not be below `state.first_sweep`.
std::span<const Sweep> finished_from(const BurrState& state, std::uint64_t number);
/// All complete sweeps still stored, as cuts of a device.
std::vector<Cut> finished_cuts(const BurrState& state, std::uint32_t device);

}  // namespace palpate
