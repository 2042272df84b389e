#pragma once

#include <array>
#include <bitset>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/haptics/feel.h"
#include "palpate/haptics/holes.h"
#include "palpate/haptics/owners.h"
#include "palpate/haptics/yield.h"
#include "palpate/sampling/surface.h"

/// Contact that keeps the tool out: a proxy of the tip stays on the surfaces while the tip goes inside, and
/// a spring pulls the hand towards it (Zilles & Salisbury 1995; on implicit surfaces Salisbury & Tarr 1997).
/// Positions in the patient frame, so that a proxy that sticks rides on a turning object.
namespace palpate {

/// A surface with how it feels: a structure's own, or one that structures which touch have in common. Two
/// surfaces side by side are both rounded where they meet, and a tool falls into the crack.
///
/// What is stiffer than what lies around it is a layer within: fat and bone that touch have one surface, on
/// which the tool leans with fat's stiffness, and the bone has another one a layer deeper, with what it is
/// stiffer than fat. Each layer holds the tool out by itself, so that the force is the stiffness summed up
/// along the way in, as in the inward ramp (docs/decisions/0011-inward-ramps.md), and each layer's spring
/// stores the energy that it gives.
///
/// A structure that yields gives what soft tissue gives at that depth (yield.h) in place of its stiffness. It
/// belongs to the outermost layer of those that it touches, and what is hard within has all of its own.
struct FeltSurface {
  std::shared_ptr<const Surface> surface;  ///< null: the structure is met by common surfaces alone
  double stiffness_N_per_mm = 1;
  double static_friction = 0.1;   ///< coefficient up to which the proxy sticks; at least dynamic_friction
  double dynamic_friction = 0.1;  ///< coefficient with which it slides
  /// Force that makes the tool go through; infinite: never.
  double puncture_N = std::numeric_limits<double>::infinity();
  bool stays_open = false;  ///< where it was gone through
  /// Of a common surface: by whose shares it feels in place of its own values.
  std::shared_ptr<const Owners> owners = nullptr;
  /// The structure whose surface this is besides the one that stands at its own place. -1: none.
  int structure = -1;
  /// The common surface that it is part of: it is met only while the tool has gone through that. -1: of none.
  int beneath = -1;
  /// Structures of a common surface that open it when they are gone through.
  std::vector<std::int16_t> opened_by = {};
  /// 0: outermost. Of a structure the layer that gives the last of its stiffness.
  int layer = 0;
  /// The part of its structures' stiffness that the layer gives; of those whose own layer it is, all that is
  /// above the lower bound.
  double from_N_per_mm = 0, to_N_per_mm = std::numeric_limits<double>::infinity();
  /// What a burr's motor works to take a cubic millimetre away (palpate/tissue/removal.h); infinite: it
  /// cannot.
  double cutting_energy_mJ_per_mm3 = std::numeric_limits<double>::infinity();
  /// Where something was taken from it (palpate/tissue/carving.h): the surface as prepared, and the labels
  /// that it was prepared from. A place that lies beneath that surface belongs to whom these say.
  std::shared_ptr<const Surface> made = nullptr;
  std::shared_ptr<const Bricks<LabelId>> made_labels = nullptr;
  /// Of a structure: no burr takes anything from it (palpate/tissue/removal.h).
  bool kept = false;
  /// So much nearer than it was cut it may be read where something was taken from it
  /// (CarvedSurface::short_mm).
  double short_mm = 0;
  double yield_modulus_N_per_mm2 = 0;  ///< of a structure that yields: E / (1 - nu2); 0: it is a spring
  RelaxedParts relaxed = {};           ///< of a structure that yields, by the model's times
};
/// A felt structure that a burr is to spare.
struct ProtectedStructure {
  LabelId label = 0;
  std::shared_ptr<const Surface> surface;  ///< its own, as prepared
  bool kept = false;                       ///< a burr is held out of it
};
/// Whose a place on a surface is: of a common surface the shares of its structures there.
/// @param index  of the surface
OwnerShares owners_at(std::span<const FeltSurface> surfaces, int index, const Point<Patient>& at);
/// Whose the last four places were: a tool that rests on a few asks for the same ones in every tick.
class OwnersMemo {
 public:
  /// As owners_at().
  OwnerShares at(std::span<const FeltSurface> surfaces, int index, const Point<Patient>& place);

 private:
  struct Known {
    std::uint64_t owners = 0;  ///< number(); 0: nothing
    int surface = -1;
    bool cut = false;  ///< it has been; what it was made of stays the same then
    Point<Patient> place;
    OwnerShares shares;
  };
  std::array<Known, 4> known_;
  std::size_t next_ = 0;
};
inline constexpr std::size_t kMostSurfaces = 1024;
using SurfaceSet = std::bitset<kMostSurfaces>;

/// A part of the tool: a sphere, or a capsule, which is a sphere swept along a line, on which it may widen
/// evenly. A point is the smallest sphere there is.
struct ToolSphere {
  Vector<Patient> offset_mm;  ///< from the tip, as the tool is turned now
  double radius_mm = 0;
  /// Of a capsule: from offset_mm, one end of its axis, to the other end. 0: a sphere.
  Vector<Patient> along_mm = {};
  /// Of a capsule: by so much its radius is greater at the other end; below 0: less. The radius stays above
  /// 0.
  double widens_mm = 0;
  /// Of a capsule: the row of spheres that it is felt as is that of so thin a one. 0: as thin as it is. One
  /// whose radii change is felt at the same places of its axis.
  double row_radius_mm = 0;

  /// @param part  of the axis, 0 at offset_mm ... 1 at the other end
  double radius_at_mm(double part) const { return radius_mm + widens_mm * part; }
};
inline constexpr std::size_t kMostToolSpheres = 4;

/// Where a part of the tool lies nearest to a surface.
struct NearestPart {
  /// Of the sphere's centre there, in the surface's own measure, less what the capsule has widened by: with
  /// radius_mm taken off it is the clearance.
  double distance_mm = 0;
  double part = 0;  ///< of the axis, 0 ... 1
};
/// Found as a proxy finds it, on the row of spheres that a capsule is felt as. Allocates, locks and throws
/// nothing.
/// @param at         the tip
/// @param enough_mm  of a capsule that is nowhere nearer a lower bound above that
NearestPart nearest_part(const Surface& surface, const ToolSphere& sphere, const Point<Patient>& at,
                         double enough_mm = std::numeric_limits<double>::infinity());

/// Where the hand holds the tool.
struct ToolPose {
  Point<Patient> tip;           ///< finite
  Eigen::Quaterniond attitude;  ///< from the tool's axes to the patient's, unit

  /// A tool that never turns is where its tip is.
  /// @param turned  a rotation, of any length but 0
  ToolPose(const Point<Patient>& at, const Eigen::Quaterniond& turned = Eigen::Quaterniond::Identity())
      : tip(at), attitude(turned.normalized()) {}
};

/// A tool's spheres as another attitude turns them; the same bits where it is the same.
class TurnedTool {
 public:
  /// @param spheres  as attitude `from` turns them, at most kMostToolSpheres
  TurnedTool(std::span<const ToolSphere> spheres, const Eigen::Quaterniond& from,
             const Eigen::Quaterniond& to);
  std::span<const ToolSphere> spheres() const { return {spheres_.data(), count_}; }

 private:
  std::array<ToolSphere, kMostToolSpheres> spheres_;
  std::size_t count_;
};

/// Where a sphere or capsule of the tool leans on a surface.
struct ProxyContact {
  int surface = -1;
  int sphere = 0;
  double part = 0;         ///< of a capsule: where on its axis, 0 at offset_mm ... 1 at the other end
  Vector<Patient> normal;  ///< outward, unit
  double pull_mm = 0;      ///< along the normal: what it adds to the way from the tip to the proxy
};
/// From the tip to where it acts.
inline Vector<Patient> arm_of(const ProxyContact& contact, const ToolSphere& sphere) {
  return sphere.offset_mm + sphere.along_mm * contact.part -
         contact.normal * sphere.radius_at_mm(contact.part);
}
/// Coefficients of what is touched.
struct Friction {
  double still = 0, sliding = 0;
};
/// What a proxy that rests touches: while the same tool stays where it is and can meet the same surfaces, a
/// tick need not look again. Of tools without capsules.
class TouchedAtRest {
 public:
  struct Wall {
    Vector<Patient> normal;  ///< outward, unit
    double offset_mm = 0;    ///< the tip's proxy may be where normal . p is at least that
    int surface = -1, sphere = 0;
    std::optional<Friction> friction = std::nullopt;  ///< where somebody asked for it
  };
  static constexpr std::size_t kMostWalls = 4;

  /// What was touched; none where nothing is known of this place.
  std::span<const Wall> find(const Point<Patient>& position, const SurfaceSet& punctured,
                             std::span<const ToolSphere> spheres) const;
  void remember(const Point<Patient>& position, const SurfaceSet& punctured,
                std::span<const ToolSphere> spheres, std::span<const Wall> walls);
  void forget() { walls_ = 0; }

 private:
  struct Sphere {
    Vector<Patient> offset_mm;
    double radius_mm = 0;
  };
  std::array<Wall, kMostWalls> wall_;
  std::size_t walls_ = 0, spheres_ = 0;
  Point<Patient> position_;
  SurfaceSet punctured_;
  std::array<Sphere, kMostToolSpheres> sphere_;
};
/// A corner of three walls, each of which may be met by every sphere of the tool.
inline constexpr std::size_t kMostContacts = 3 * kMostToolSpheres;

inline constexpr int kMostLayers = 12;

/// What is remembered of a layer between two ticks.
struct ProxyLayer {
  /// False: the tip has not been free since contact began anew (start, clutch, pause, jump, a surface that
  /// has grown over it), so that nobody knows on which side it is. No force then.
  bool coupled = false;
  bool sticking = false;
  Point<Patient> position;  ///< of the tip's proxy
  /// Of its tool, as ToolPose has it: the hand's, or what walls and a tick's work have left of its turn.
  Eigen::Quaterniond attitude = Eigen::Quaterniond::Identity();
  Vector<Patient> last_way;  ///< its last stride, mm: the next one is not to go to and fro
  SurfaceSet punctured;      ///< the tool has gone through surface n and not come out yet
  /// How much of the way from the tip to it the spring is stretched by; below 1 where it leans on what it
  /// cannot pass and no wall says why.
  double part = 1;
  /// Force over length of its spring; 0: it gave nothing. None: nobody knows, as after a change of the
  /// surfaces.
  std::optional<double> spring_N_per_mm;
  double behind_mm = 0;  ///< that the hand went while it came after it through free space, without force
  double lost_s = 0;     ///< that it has been left behind by a free tip
  int contacts = 0;
  std::array<ProxyContact, kMostContacts> contact;
  // these change nothing but how long a tick takes
  OwnersMemo owners;
  TouchedAtRest at_rest;
};

/// What is left of the forces of layers that have been let go because the tool has left the layer around
/// them.
struct ProxyRelease {
  Vector<Patient> force_N;     ///< on the tip
  Vector<Patient> torque_Nmm;  ///< about the tip
  double stored_mJ = 0;

  /// Shortens the force by at most so much. Returns by how much.
  double fade(double most_N);
  /// Shortens the force to at most so much.
  void limit(double most_N);
};

/// What is remembered between two ticks: of the outermost layer, and of those within. Small and without
/// pointers.
struct ProxyState : ProxyLayer {
  std::array<ProxyLayer, kMostLayers - 1> within;
  Point<Patient> tip;             ///< where it was
  double stiffness_N_per_mm = 0;  ///< of all springs then, as it grew; 0: nothing was touched
  YieldState yield;               ///< of what yields of the outermost layer
  RelaxationState relaxation;     ///< likewise
  ProxyRelease release;
  Point<Patient> free_tip;  ///< where the tip last was free: the outermost proxy followed the hand there
  Eigen::Quaterniond free_attitude = Eigen::Quaterniond::Identity();  ///< of the tool then
  Point<Patient> looked_tip;  ///< from where a free way to that pose was looked for last

  const ProxyLayer& layer(int n) const { return n == 0 ? *this : within[static_cast<std::size_t>(n - 1)]; }
  ProxyLayer& layer(int n) { return n == 0 ? *this : within[static_cast<std::size_t>(n - 1)]; }
};

struct ProxyOptions {
  bool friction = true;
  /// Stiffer surfaces are felt as this stiff: the most that a hand holds with the device.
  double most_stiffness_N_per_mm = std::numeric_limits<double>::infinity();
  double dt_s = 0.001;  ///< since the last call
  /// On the tip: so fast springs let go where the proxy slips.
  double most_slip_N_per_s = kProxyFeel.most_slip_N_per_s;
  /// What is known of structures that yield, and which of its spots; null: nothing, they are half spaces.
  const YieldFrame* yields = nullptr;
  std::size_t device = 0;
  const RelaxationTimes* relaxation_times = nullptr;  ///< of the model; null: nothing relaxes
  Holes* holes = nullptr;         ///< of all tools, in tissue that stays open; null: everything closes
  double away = kProxyFeel.away;  ///< part of a stride that may lead away from the tip
  /// On the tip: more is not sent, and a release does not begin with more.
  double most_force_N = std::numeric_limits<double>::infinity();
};

/// What the springs from the tip to the proxies give.
struct ProxyForce {
  Vector<Patient> force_N;     ///< on the tip
  Vector<Patient> torque_Nmm;  ///< about the tip, of the tool as the proxy holds it
  /// Force over depth of what is touched: in a layer weighted by pulls and shares, summed over the layers.
  double stiffness_N_per_mm = 0;
  /// How the force grows with the depth: the same, but of what yields.
  double tangent_N_per_mm = 0;
  double stored_mJ = 0;
  bool yields = false;  ///< something that yields is touched
};

/// What lies along the tip's way in: the force is the stiffness summed up along it, so that each structure
/// gives its own stiffness times the way within it.
struct FeltPart {
  int structure = -1;  ///< its place among the surfaces
  /// Of the way that lies within it; at a seam its share of that, so that all add up.
  double depth_mm = 0;
  double share = 0;  ///< of the force, 0 ... 1
};
inline constexpr std::size_t kMostFeltParts = 6;

/// Of all layers, with what is still being released.
struct ProxyResult : ProxyForce {
  std::array<ProxyForce, kMostLayers> of_layer;  ///< each layer's part of it
  ProxyRelease release;                          ///< likewise; no contact is told for it
  /// Outermost first; none without contact. Of more than there is room for, those that give most.
  std::array<FeltPart, kMostFeltParts> felt;
  int felt_parts = 0;
  /// Mean coefficient of what is touched, static where it sticks; 0 where friction is off.
  double friction = 0;
  Vector<Patient> normal;  ///< of all walls of all layers together, unit; 0 without contact
  /// The tool is wider than the gap that it is in: no place is left by all walls, and the proxy stays, or its
  /// attitude does while the hand's turns on. Where the tool has become another one and lies in walls,
  /// without force, until the tip is free.
  bool wedged = false;
  bool ruptured = false;  ///< it went through a surface in this tick
  /// The hand moved or turned farther than one tick's work follows, or the proxy slips; it goes on in the
  /// next. What it leans on is not gone through meanwhile.
  bool lagging = false;
};

/// One tick: the proxy turns from its attitude to the hand's and goes from where it was towards the tip,
/// along surfaces and never through them. The whole way is looked at, in steps that the clearance allows: at
/// no place of it does a sphere lie deeper than ProxyFeel::most_dip_mm below a surface. Then the spring.
/// Bounded work; allocates, locks and throws nothing.
///
/// - A capsule is felt as a row of spheres, so close that their outline is at most 0.01 mm within its own, or
///   0.15 mm apart where it is thin (docs/decisions/0023). It leans where it touches, and in the middle of
///   that where it lies along.
/// - A turn: the attitude is the hand's, which no force holds back, and the place yields, so that what the
///   tool turns into pushes the tip away and is felt there (docs/decisions/0019).
/// - Free space is crossed in strides of the clearance (sphere tracing, Hart 1996).
/// - On surfaces the goal is the point nearest to the tip in the half-spaces of all that is touched, by
///   active set; so corners, gaps and both walls of a notch hold.
/// - A proxy that slips, where the nearest place is suddenly another, goes there no faster than its springs
///   may let go (most_slip_N_per_s), through free space too; what was gone through lets go at once
///   (docs/decisions/0033). Nor does the stiffness change faster, where the proxy comes from one structure to
///   another under a long spring.
/// - A layer holds the tool only while the layer around it does. Once the outer proxy follows the hand, the
///   tip is outside all inner layers: their proxies are put at the tip as well, and their force fades at the
///   pace of a slip (docs/decisions/0076-layers-hold-while-covered.md).
/// - The outermost layer holds the tool until it has come back out of the tissue: it is clear of the layer,
///   and nothing lies on the straight way to the pose in which it was free before. A proxy that is held
///   elsewhere then, as by a pocket into which it was pressed, is put at the tip in the same way.
/// - Friction: the proxy sticks while its way to the goal is at most static_friction times the depth, and
///   slides to dynamic_friction times the depth (friction cone: Harwin & Melder 2002).
/// - Stiffness and friction are those of the structures touched, weighted by their pulls, and on a common
///   surface by their shares of the place. Every layer has a proxy of its own, and the forces add up.
/// - A structure is gone through when what it gives of the springs' force, friction aside and before any
///   limit, stiffness included, is above its puncture force. It opens the common surfaces that it is part of,
///   so that what lies beneath is met by surfaces of its own; each closes again when tip and proxy have left
///   it. One that stays open keeps a hole: where all that leans on it lies in its holes, it is gone through
///   again without force.
/// @param surfaces  at most kMostSurfaces; the same ones in every call with one state
/// @param spheres   1 ... kMostToolSpheres
/// @param hand      the attitude by which `spheres` are turned
ProxyResult advance_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                          const ToolPose& hand, ProxyState& state, const ProxyOptions& options = {});

/// After a change of the surfaces. What has not changed shape keeps the proxy as it is: where it is, what it
/// sticks to, what it has gone through. A structure that was gone through and has another shape now is still
/// gone through. A proxy that lies inside a surface that is new or has another shape is let go: nobody knows
/// on which side of that it is.
/// @param hand    the attitude by which `spheres` are turned
/// @param before  one for each of `surfaces`; empty where nothing is known of those before: all are new
void keep_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                const ToolPose& hand, std::span<const SurfaceBefore> before, ProxyState& state);

/// Couples a tip that is inside: its proxy is born at the nearest place outside all surfaces. False where
/// there is none within their reach. The caller lets the force ramp in.
bool give_birth_to_proxy(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                         const ToolPose& hand, ProxyState& state);

/// After a change of the surfaces by which structures lie in other layers. The outermost proxy stays where
/// keep_proxy leaves it. Where that lets it go, and in the layers within, one is born at the nearest place
/// outside of what the tool has not gone through; what it has gone through stays open. What yields is pressed
/// anew. A tip of which nobody knew on which side it is stays without force until it is free. The caller
/// blends the force.
/// @param before  as of keep_proxy
void layer_proxy_anew(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres,
                      const ToolPose& hand, std::span<const SurfaceBefore> before, ProxyState& state);

}  // namespace palpate
