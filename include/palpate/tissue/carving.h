#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/tissue/stroke_history.h"
#include "palpate/tissue/sweep.h"

/// Tissue that is taken away by a tool. A surface is carved as it was prepared and never smoothed anew: what
/// the tool's head swept is subtracted from it, and distances around follow.
namespace palpate {

/// A surface with all that was ever taken from it. A version is a value: with() makes the next one, which
/// shares everything that did not change; undoing is going back to one that was kept.
///
/// With S the signed distance as prepared and C the depth within the union of all sweeps (SweptShape; for
/// many the greatest), at every voxel of the position's grid:
///
///     inside and beside the surface   max(S, C)
///     free, and free when prepared    S, and by how much the nearest material is farther away now
///     free, and cut                   the distance to what is left
///
/// Where structures are kept, with K the least of their signed distances as prepared, it is min(C, K) in
/// place of C: what lies in them stays.
///
/// Every voxel follows from S and C near it alone, so that it is the same bit for bit however many versions
/// led to it and in whatever order. The cells through which the surface passes hold max(S, C) at all corners:
/// it lies where the sweeps end, to what trilinear interpolation keeps, and is not rounded.
///
/// The distance to what is left: the least, over voxels y in the cells through which the surface passes and
/// a little deeper, of the way to y and y's own distance, which is negative inside. Exact where one of them
/// lies on the line through the nearest place. (Additively weighted distance transform; the distances make it
/// finer than a voxel.) Before an edge that two sweeps leave it is a little short, so that no slope is much
/// steeper than a distance's.
///
/// The normal is the prepared one where nothing is taken away, and the new position's where something is.
class CarvedSurface {
 public:
  /// @param made  as prepared; its grid's axes perpendicular
  /// @param kept  surfaces of structures of which nothing is taken away
  explicit CarvedSurface(std::shared_ptr<const Surface> made,
                         std::vector<std::shared_ptr<const Surface>> kept = {});

  /// After more sweeps. The work goes with the box around all of them.
  CarvedSurface with(std::span<const Sweep> sweeps) const;

  /// As it is now. The very surface that was prepared while nothing is taken from it.
  const std::shared_ptr<const Surface>& surface() const { return now_; }
  /// As it was prepared.
  const std::shared_ptr<const Surface>& made() const { return made_; }
  /// By so much a head does not fit at most where it has just been, as the surface is read between voxels:
  /// the axis of a hole lies on a ridge of the distance, which trilinear interpolation cuts off.
  double short_mm() const { return short_mm_; }

 private:
  std::shared_ptr<const Surface> made_, now_;
  std::vector<std::shared_ptr<const Surface>> kept_;
  Bricks<std::int16_t> cut_;  ///< C, in steps of the position
  /// Of every brick of the position that is not the prepared one: its greatest slope. 0: it is that.
  std::vector<double> steepest_;
  double short_mm_ = 0;
};

/// A sweep of one device's burr.
struct Cut {
  std::uint32_t device = 0;  ///< below kMaxDevices
  Sweep sweep;
};

Cut cut_of(const SweepRecord& sweep);
SweepRecord plain(const Cut& cut);

/// All that is taken from a model's surfaces and labels. A version is a value, as that of a surface. It holds
/// what the last kMostUndone strokes led from and to, which shares everything that did not change.
class Carving {
 public:
  /// Nothing taken yet.
  explicit Carving(const Model& model);
  /// After more cuts; takes milliseconds where a burr was at work for some. Of the labels, those that are
  /// felt and not kept are gone where their voxels' centres were swept.
  std::shared_ptr<const Carving> with(std::span<const Cut> cuts) const;

  /// Without the last stroke; null where none can be undone. Bit for bit as it was before that stroke, but
  /// for sweeps(), which never goes down.
  std::shared_ptr<const Carving> undone() const;
  /// With the stroke that was undone last, likewise; null where there is none.
  std::shared_ptr<const Carving> redone() const;
  std::size_t strokes_to_undo() const { return strokes_.done().size(); }
  std::size_t strokes_to_redo() const { return strokes_.undone().size(); }

  /// The model's labels before anything was taken.
  const std::shared_ptr<const Bricks<LabelId>>& made_labels() const { return made_labels_; }
  /// Of every voxel of what is cut: what part of it is gone, of 255, finer than labels say it, so that soft
  /// tissue gives way little by little (YieldSolver). The greatest of all sweeps', so the same whatever their
  /// order. null while nothing is gone, and of models whose tissue does not yield.
  const std::shared_ptr<const Bricks<std::uint8_t>>& taken() const { return left_.taken; }
  /// Whether taken() is known: the tissue moved when the carving was begun.
  bool tells_parts() const { return tells_parts_; }

  /// How many sweeps of a device's burr it has taken, counted from the start; those that were undone too.
  std::uint64_t sweeps(std::size_t device) const { return sweeps_[device]; }
  /// Model::content_hash with this taken from it. @param uncut  Model::uncut_hash, which it is where nothing
  /// is
  std::uint64_t content_hash(std::uint64_t uncut) const;
  /// The next version of a model that has other parts taken from it, or nothing: a local edit.
  /// @param felt  the model that the carving was begun with, or one that followed from it
  std::shared_ptr<const Model> taken_from(const Model& felt) const;

 private:
  // what is left
  struct Left {
    std::vector<std::shared_ptr<const CarvedSurface>> surfaces;  // null: nothing is taken from it
    std::shared_ptr<const Bricks<LabelId>> labels;
    std::shared_ptr<const Bricks<std::uint8_t>> taken;
    std::uint64_t hash = 0;  // of all cuts that led to it, in their order; 0: of none
  };
  struct Stroke {
    std::shared_ptr<const Left> before, after;  // after: once it was undone
  };
  void take(std::span<const Cut> cuts);
  void take_parts(const Sweep& sweep);

  // by surface; null: it is met by common ones, or nothing is taken from it. Then those that distances are
  // measured to and nobody leans on.
  std::vector<std::shared_ptr<const Surface>> made_;
  std::size_t felt_ = 0;  // how many of them are surfaces of the model
  std::vector<int>
      made_of_tracked_;  // by structure of Model::distances, its place in made_; -1: it is not cut
  std::shared_ptr<const Bricks<LabelId>> made_labels_;
  std::vector<bool> is_cut_;  // by label
  bool tells_parts_ = false;
  std::vector<std::shared_ptr<const Surface>> kept_;  // of structures of which nothing is taken
  std::array<std::uint64_t, kMaxDevices> sweeps_{};
  Left left_;
  StrokeHistory<Stroke> strokes_;
};

}  // namespace palpate
