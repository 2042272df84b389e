#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/model.h"
#include "palpate/device/sweep_record.h"
#include "palpate/device/telemetry.h"
#include "palpate/tissue/cutting_energy.h"
#include "palpate/tissue/stroke_history.h"
#include "palpate/tissue/sweep.h"
#include "palpate/tissue/swept_samples.h"

/// Material removal. A surface is carved from its prepared form without smoothing it again: the volume that
/// the tool's head swept is subtracted, and distances nearby are updated.
namespace palpate {

/// A surface with all material ever removed from it. Instances are immutable values: with() returns the next
/// version, which shares all unchanged data. To undo, return to an earlier version.
///
/// With S the prepared signed distance and C the depth within the union of all sweeps (the greatest
/// SweptShape depth), the value at every voxel of the distance field's grid is:
///
///     inside and adjacent to the surface   max(S, C)
///     free, and free when prepared         S plus the increase of the distance to the nearest material
///     free, and cut                        the distance to the remaining material
///
/// With protected structures, of which nothing is removed, C is replaced by min(C, K), where K is the least
/// of their prepared signed distances.
///
/// Every voxel depends only on S and C in its neighbourhood, so the result is the same bit for bit for any
/// number and order of versions. Cells through which the surface passes hold max(S, C) at all corners: the
/// surface lies where the sweeps end, up to trilinear interpolation, and is not rounded.
///
/// The distance to the remaining material is the least, over voxels y in the cells through which the surface
/// passes and slightly deeper, of |p - y| plus the (negative) distance at y: an additively weighted distance
/// transform, accurate to less than a voxel because of the weights. It is exact if such a voxel lies on the
/// line through the nearest point. In front of an edge between two sweeps it is slightly too small, so that
/// no slope is much steeper than that of a distance.
///
/// The normal is the prepared one where nothing was removed, and that of the new distance field elsewhere.
class CarvedSurface {
 public:
  /// @param original            prepared surface; the axes of its grid must be perpendicular
  /// @param protected_surfaces  surfaces of protected structures
  explicit CarvedSurface(std::shared_ptr<const Surface> original,
                         std::vector<std::shared_ptr<const Surface>> protected_surfaces = {});

  /// Version after more sweeps. The cost is proportional to the volume of their bounding box.
  CarvedSurface with(std::span<const Sweep> sweeps) const;

  /// Current surface. The same object as original() while nothing has been removed.
  const std::shared_ptr<const Surface>& surface() const { return now_; }
  /// Prepared surface.
  const std::shared_ptr<const Surface>& original() const { return original_; }
  /// Largest amount by which a head exceeds the clearance at a position it has just cut, in the interpolated
  /// surface: the axis of a hole lies on a ridge of the distance, which trilinear interpolation flattens.
  double clearance_error_mm() const { return clearance_error_mm_; }

 private:
  std::shared_ptr<const Surface> original_, now_;
  std::vector<std::shared_ptr<const Surface>> protected_surfaces_;
  Bricks<std::int16_t> cut_;  ///< C, in units of the distance field's steps
  /// Greatest slope of each brick of the distance field that differs from the prepared one; 0: unchanged.
  std::vector<double> max_gradient_;
  double clearance_error_mm_ = 0;
};

/// Value of Carving::removed_fraction() for a voxel that was removed completely.
inline constexpr double kFullyRemoved = 255;

/// Sweep of one device's burr, or the removal of a fragment that was cut loose (palpate/tissue/fragments.h).
struct Cut {
  static constexpr std::uint32_t kBrokenOff = SweepRecord::kBrokenOff;
  std::uint32_t device = 0;  ///< Below kMaxDevices, or kBrokenOff
  Sweep sweep;
};

/// Conversion from and to the plain numbers of telemetry.
Cut cut_of(const SweepRecord& sweep);
SweepRecord record_of(const Cut& cut);

/// Bone classes, as array indices: thick bone, which is measured from its surface, and thin bone, which is
/// measured from its voxels (Model::thin_voxels).
enum BoneClass : std::size_t { kThick, kThin, kBoneClasses };

/// Material removed by a burr, i.e. covered by its sweeps but by no earlier ones, counted in sample points of
/// the voxels (SweptSamples). Volume and cutting energy are those of the structures in the innermost layer of
/// contact, on which a burr's motor works (palpate/tissue/removal.h); softer structures around them are not
/// counted.
struct CarvedMaterial {
  std::uint64_t sweeps = 0;  ///< Number of sweeps
  std::array<double, kBoneClasses> volume_mm3{}, energy_mJ{};
};

/// All material removed from a model's surfaces and labels. Instances are immutable values, like
/// CarvedSurface. Contains the states before and after the last kMaxUndoneStrokes strokes, which share all
/// unchanged data.
class Carving {
 public:
  /// Nothing removed yet.
  explicit Carving(const Model& model);
  /// Version after further cuts; takes milliseconds for a few milliseconds of cutting. Voxels of touchable,
  /// unprotected labels are cleared if their centre was swept.
  std::shared_ptr<const Carving> with(std::span<const Cut> cuts) const;

  /// Version without the last stroke; null if none can be undone. Bit for bit the state before that stroke,
  /// except sweeps(), which never decreases.
  std::shared_ptr<const Carving> undone() const;
  /// Version with the last undone stroke restored; null if there is none.
  std::shared_ptr<const Carving> redone() const;
  std::size_t strokes_to_undo() const { return strokes_.done().size(); }
  std::size_t strokes_to_redo() const { return strokes_.undone().size(); }

  /// Remaining labels.
  const std::shared_ptr<const Bricks<LabelId>>& labels() const { return remaining_.labels; }
  /// Labels before any removal.
  const std::shared_ptr<const Bricks<LabelId>>& original_labels() const { return original_labels_; }
  /// Removed fraction of every voxel, 0 ... 255, finer than the labels so that soft tissue loses stiffness
  /// gradually (SoftTissueSolver). The maximum over all sweeps, so independent of their order. null while
  /// nothing is removed, and for models without deformable tissue.
  const std::shared_ptr<const Bricks<std::uint8_t>>& removed_fraction() const {
    return remaining_.removed_fraction;
  }
  /// Whether removed_fraction() is recorded: the tissue was deformable (TissueLaw) when the carving began.
  bool records_fractions() const { return records_fractions_; }

  /// Number of sweeps of a device's burr that have been applied since the start, including undone ones.
  std::uint64_t sweeps(std::size_t device) const { return carved_[device].sweeps; }
  /// Material that a device's burr has removed since the start, including what was restored by an undo. It
  /// depends on the sweeps and their order alone, not on the number of versions.
  const CarvedMaterial& carved(std::size_t device) const { return carved_[device]; }
  /// Model::content_hash after this removal.
  /// @param uncut  Model::hash_before_removal, which is returned if nothing was removed
  std::uint64_t content_hash(std::uint64_t uncut) const;
  /// Next version of a model, with this carving's removal in place of the model's own: a local edit.
  /// @param model  the model with which the carving began, or a later version of it
  std::shared_ptr<const Model> applied_to(const Model& model) const;

 private:
  // remaining material
  struct Remaining {
    std::vector<std::shared_ptr<const CarvedSurface>> surfaces;  // null: nothing removed from it
    std::shared_ptr<const Bricks<LabelId>> labels;
    std::shared_ptr<const Bricks<std::uint8_t>> removed_fraction;
    SweptSamples swept;      // in labels with a cutting energy
    std::uint64_t hash = 0;  // digest of all cuts applied, in order; 0: none
  };
  struct Stroke {
    std::shared_ptr<const Remaining> before, after;  // after: set by the first undo
  };
  void apply(std::span<const Cut> cuts);
  void account_for(const Cut& cut);
  void record_removed_fractions(const Sweep& sweep);

  // Prepared surfaces: those of the model by index, then those that distances are measured to but that have
  // no contact. null: part of a common surface, or protected.
  std::vector<std::shared_ptr<const Surface>> original_surfaces_;
  std::size_t tracked_surfaces_ = 0;      // number of original_surfaces_ that are surfaces of the model
  std::vector<int> original_of_tracked_;  // index into original_surfaces_ for each structure of
                                          // Model::distance_trees; -1: not cut
  std::shared_ptr<const Bricks<LabelId>> original_labels_;
  std::vector<bool> is_cuttable_;                            // by label
  CuttingEnergy cutting_energy_;                             // by original label
  std::shared_ptr<const Bricks<std::uint8_t>> thin_voxels_;  // may be null
  bool records_fractions_ = false;
  std::vector<std::shared_ptr<const Surface>> protected_surfaces_;  // surfaces of protected structures
  std::array<CarvedMaterial, kMaxDevices> carved_{};
  Remaining remaining_;
  StrokeHistory<Stroke> strokes_;
};

}  // namespace palpate
