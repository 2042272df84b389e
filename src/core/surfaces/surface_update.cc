#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <memory>

#include "palpate/surfaces/surfaces.h"
#include "surfaces/surface_net.h"
#include "surfaces/surface_net_distance.h"
#include "surfaces/surface_slopes.h"
#include "surfaces/surface_stages.h"

/// Local update of a prepared surface after its labels changed inside a box.
namespace palpate {
namespace {

using internal::full_span;
using internal::Span3;
using internal::StepsSource;
using internal::SurfacePlan;
using internal::SurfaceStage;
using internal::SurfaceStages;
using internal::to_box;
using internal::to_span;

/// Whether all of a structure's voxels in a changed box are within its surface's extent.
bool is_within_extent(const Bricks<LabelId>& labels, LabelId label, const Span3& extent,
                      const Span3& changed) {
  bool within = true;
  internal::for_each_row(labels, changed, [&](int j, int k, const LabelId* row) {
    const bool beside = j < extent.low[1] || j >= extent.high[1] || k < extent.low[2] || k >= extent.high[2];
    for (int i = changed.low[0]; i < changed.high[0]; ++i) {
      const bool beyond = beside || i < extent.low[0] || i >= extent.high[0];
      within = within && !(beyond && row[i - changed.low[0]] == label);
    }
  });
  return within;
}

/// Bounding box of voxels whose class changed, in the structure's grid, and the net gain of voxels.
Span3 find_changes(const PreparedSurface& old, const Bricks<LabelId>& labels, const Span3& dirty,
                   long& more) {
  Span3 changed;
  more = 0;
  std::vector<std::int16_t> was(static_cast<std::size_t>(dirty.size(0)));
  internal::for_each_row(labels, dirty, [&](int j, int k, const LabelId* now) {
    const int v = j - old.box.first[1], w = k - old.box.first[2];
    old.intermediates.distance.copy_row(dirty.low[0] - old.box.first[0], v, w, dirty.size(0), was.data());
    const auto is_inside = [&](int i) { return now[i - dirty.low[0]] == old.label; };
    const auto differs = [&](int i) {
      return is_inside(i) != (was[static_cast<std::size_t>(i - dirty.low[0])] < 0);
    };
    // most rows are unchanged
    int found = 0;
    for (int i = dirty.low[0]; i < dirty.high[0]; ++i) found += differs(i);
    if (found == 0) return;
    for (int i = dirty.low[0]; i < dirty.high[0]; ++i) {
      if (!differs(i)) continue;
      const int u = i - old.box.first[0];
      more += is_inside(i) ? 1 : -1;
      const bool fresh = changed.empty();
      const internal::Index3 at{u, v, w};
      for (int a = 0; a < 3; ++a) {
        changed.low[a] = fresh ? at[a] : std::min(changed.low[a], at[a]);
        changed.high[a] = fresh ? at[a] + 1 : std::max(changed.high[a], at[a] + 1);
      }
    }
  });
  return changed;
}

/// Bounding box of both.
Span3 hull(const Span3& a, const Span3& b) {
  if (a.empty()) return b;
  if (b.empty()) return a;
  Span3 s = a;
  for (int n = 0; n < 3; ++n) {
    s.low[n] = std::min(a.low[n], b.low[n]);
    s.high[n] = std::max(a.high[n], b.high[n]);
  }
  return s;
}

/// Bounding box of the values in which a patch differs from the old field.
Span3 differences(const PatchOf<std::int16_t>& patch, const Bricks<std::int16_t>& old) {
  Span3 found;
  const std::int16_t* now = patch.values.data();
  const Span3 span = to_span(patch.box);
  const int length = span.size(0);
  std::vector<std::int16_t> before(static_cast<std::size_t>(length));
  internal::for_each_row(span, [&](int j, int k) {
    old.copy_row(span.low[0], j, k, length, before.data());
    if (std::memcmp(now, before.data(), before.size() * sizeof *now) != 0) {
      const auto first = static_cast<int>(std::mismatch(now, now + length, before.begin()).first - now);
      int last = length - 1;
      while (now[last] == before[static_cast<std::size_t>(last)]) --last;
      found = hull(found, {{span.low[0] + first, j, k}, {span.low[0] + last + 1, j + 1, k + 1}});
    }
    now += length;
  });
  return found;
}

/// Carved net of some cells for the current classes.
internal::SurfaceNet carved(const internal::SurfaceNet& original, const StepsSource& distance,
                            const Span3& cells) {
  Span3 voxels = cells;
  for (int& high : voxels.high) ++high;
  internal::Block<std::int16_t> sides = internal::gather(distance, {1, 1, 1}, voxels, 1);
  for (std::int16_t& side : sides.values()) side = side < 0 ? std::int16_t{-1} : std::int16_t{1};
  internal::SurfaceNet net = internal::make_net([&](int j, int k) { return sides.row(j, k); }, cells,
                                                original.spacing_mm.cast<double>());
  internal::carve_net(original, net);
  return net;
}

/// Region of influence of a change, in the structure's grid.
class SurfaceUpdate {
 public:
  /// @param changed  bounding box of voxels whose class changed
  SurfaceUpdate(const SurfacePlan& plan, const internal::SurfaceNet& original, const Span3& changed)
      : plan_(plan), original_(original), fine_(full_span(plan.fine)) {
    // nodes of cells at the change, those affected by relaxation, and triangles at them
    moved = grown(changed, internal::kCarvingRounds + 2);
    near = moved.grown(plan.window).clipped(fine_);
  }

  /// Corners, marked 1, of all cells that contain a triangle which only one of the nets has.
  internal::Block<std::uint8_t> corners(const StepsSource& before, const StepsSource& now) const {
    const Span3 cells = internal::cells_of(grown(moved, internal::kCarvingRounds + 2));
    const internal::SurfaceNet was = carved(original_, before, cells), is = carved(original_, now, cells);
    internal::Block<std::uint8_t> at(near.grown(plan_.window), 0);
    internal::Block<std::uint8_t> has_node(cells, 0);
    for (const internal::SurfaceNet* net : {&was, &is}) {
      internal::for_each_row(cells, [&](int j, int k) {
        const std::size_t r = net->row(j, k);
        for (std::uint32_t n = net->row_begin[r]; n < net->row_begin[r + 1]; ++n)
          has_node.row(j, k)[net->column[n] - cells.low[0]] = 1;
      });
    }
    internal::for_each_difference(was, is, internal::cells_of(moved), [&](const internal::Index3& cell) {
      // its triangles extend to nodes of adjacent cells
      const Span3 beside =
          Span3{cell, {cell[0] + 1, cell[1] + 1, cell[2] + 1}}.grown({1, 1, 1}).clipped(cells);
      internal::for_each_row(beside, [&](int j, int k) {
        for (int i = beside.low[0]; i < beside.high[0]; ++i) {
          if (has_node.row(j, k)[i - cells.low[0]] == 0) continue;
          std::uint8_t* first = at.row(j, k) + (i - at.span().low[0]);
          const std::ptrdiff_t row = at.span().size(0), slice = row * at.span().size(1);
          for (const std::ptrdiff_t to : {std::ptrdiff_t{0}, row, slice, row + slice})
            first[to] = first[to + 1] = 1;
        }
      });
    });
    return at;
  }

  /// Triangles that may be nearest to a voxel of a box.
  internal::NetTriangles triangles(const StepsSource& now, const Span3& voxels) const {
    const Span3 around = grown(voxels.grown(plan_.window), 2);
    const Span3 cells = internal::cells_of(grown(around, internal::kCarvingRounds + 2));
    return {carved(original_, now, cells), internal::cells_of(around)};
  }

  Span3 moved;  ///< Contains all triangles that may differ
  Span3 near;   ///< Voxels for which such a triangle may be nearest

 private:
  Span3 grown(const Span3& span, int by) const { return span.grown({by, by, by}).clipped(fine_); }

  const SurfacePlan& plan_;
  const internal::SurfaceNet& original_;
  Span3 fine_;
};

/// Bounding box of nonzero marks.
Span3 box_of(const internal::Block<std::uint8_t>& marks) {
  Span3 box;
  const Span3& span = marks.span();
  internal::for_each_row(span, [&](int j, int k) {
    const std::uint8_t* row = marks.row(j, k);
    const std::uint8_t* end = row + span.size(0);
    const auto first = static_cast<int>(std::find_if(row, end, [](auto m) { return m != 0; }) - row);
    if (first == span.size(0)) return;
    int last = span.size(0) - 1;
    while (row[last] == 0) --last;
    box = hull(box, {{span.low[0] + first, j, k}, {span.low[0] + last + 1, j + 1, k + 1}});
  });
  return box;
}

template <class T>
internal::Target<T> start(PatchOf<T>& patch, const Span3& span) {
  patch.box = to_box(span);
  patch.values.resize(span.count());
  return {patch.values.data(), span};
}

template <class T>
void write(const PatchOf<T>& patch, const internal::Index3& dims, std::vector<T>& values) {
  const T* from = patch.values.data();
  internal::for_each_row(to_span(patch.box), [&](int j, int k) {
    const std::ptrdiff_t row = std::ptrdiff_t{k} * dims[1] + j;
    std::copy_n(from, patch.box.size[0], values.data() + row * dims[0] + patch.box.first[0]);
    from += patch.box.size[0];
  });
}

}  // namespace

SurfacePatch prepare_patch(const PreparedSurface& old, const Bricks<LabelId>& labels, const VoxelBox& dirty) {
  SurfacePatch patch;
  if (old.options.drop_below_mm3 > 0) return patch;
  const Span3 known = to_span(dirty).clipped(full_span(labels.geometry()));
  if (!is_within_extent(labels, old.label, to_span(old.intermediates.extent), known)) return patch;
  const Span3 changed = find_changes(old, labels, known.clipped(to_span(old.box)), patch.voxels_more);
  if (old.volume_mm3 + static_cast<double>(patch.voxels_more) * labels.geometry().voxel_volume_mm3() <
      0.5 * labels.geometry().voxel_volume_mm3())
    return patch;
  patch.is_applicable = true;
  patch.max_gradient = old.surface.max_gradient();
  if (changed.empty()) return patch;

  // each stage covers the region that the previous one can change
  const SurfacePlan plan(labels.geometry(), old.box, old.options);
  const SurfaceStages stages{plan};
  const auto run = [&](std::initializer_list<SurfaceStage> together) {
    patch.is_applicable = patch.is_applicable && stages.run(together, {}, {"preparing surfaces"}).ok();
  };
  const Span3 fine = full_span(plan.fine), coarse = full_span(plan.normal.geometry);
  const Bricks<std::int16_t>& was = old.surface.distance_field().bricks();
  const auto old_position = StepsSource::of(was);
  const auto distance = StepsSource::of(old.intermediates.distance).with(patch.distance);
  const auto position = old_position.with(patch.position);
  const auto broad = StepsSource::of(old.intermediates.broad).with(patch.broad);

  const Span3 distance_part = changed.grown(plan.window).clipped(fine);
  run({stages.distance(labels, old.label, {}, start(patch.distance, distance_part))});
  // among voxels near the change, those whose nearest triangle may differ
  const SurfaceUpdate carving(plan, *old.intermediates.net, changed);
  const internal::Block<std::uint8_t> corners =
      carving.corners(StepsSource::of(old.intermediates.distance), distance);
  internal::Block<std::uint8_t> stale(carving.near);
  run({stages.stale(corners, old_position, {stale.values().data(), stale.span()})});
  const Span3 position_part = box_of(stale);
  const internal::NetTriangles triangles = carving.triangles(distance, position_part);
  run({stages.updated_position(triangles, distance, old_position, stale,
                               start(patch.position, position_part))});
  const Span3 moved = differences(patch.position, was);
  const Span3 broad_part = plan.normal.inside(carving.moved.grown(plan.broad_window).clipped(moved))
                               .grown(plan.broad_filter.reach())
                               .clipped(coarse);
  run({stages.broad(position, start(patch.broad, broad_part))});
  const Span3 normal_part =
      hull(broad_part, plan.normal.inside(moved)).grown(plan.normal_filter.reach()).clipped(coarse);
  const Span3 slopes_part = internal::stretches_at(plan.fine, moved);
  run({stages.normal(broad, position, start(patch.normal, normal_part)),
       stages.slopes(position, start(patch.slopes, slopes_part))});

  const float beside =
      internal::max_outside(old.intermediates.slopes, internal::stretches(plan.fine), slopes_part);
  patch.max_gradient = internal::steepest_of(std::max(beside, internal::greatest(patch.slopes.values)));
  return patch;
}

Result<PreparedSurface> update_surface(const PreparedSurface& old, const Bricks<LabelId>& labels,
                                       const VoxelBox& dirty) {
  const SurfacePatch patch = prepare_patch(old, labels, dirty);
  if (!patch.is_applicable) {
    auto all = prepare_surfaces(labels, {old.label}, old.options);
    if (!all) return all.error();
    return std::move(all->front());
  }
  if (patch.distance.values.empty()) return old;
  PreparedSurface now{.label = old.label,
                      .surface = {},
                      .options = old.options,
                      .volume_mm3 = old.volume_mm3,
                      .components = old.components,
                      .strays = old.strays,
                      .box = old.box,
                      .intermediates = old.intermediates};
  const GridGeometry& fine = old.surface.distance_field().geometry();
  now.intermediates.distance = old.intermediates.distance.with(patch.distance);
  now.intermediates.broad = old.intermediates.broad.with(patch.broad);
  write(patch.slopes, internal::stretches(fine).high, now.intermediates.slopes);
  now.surface = old.surface.with(patch.position, patch.normal, patch.max_gradient);
  // computed from the number of voxels, as in a full rebuild
  const double voxel_mm3 = fine.voxel_volume_mm3();
  now.volume_mm3 =
      (std::round(old.volume_mm3 / voxel_mm3) + static_cast<double>(patch.voxels_more)) * voxel_mm3;
  return now;
}

}  // namespace palpate
