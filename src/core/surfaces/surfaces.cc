#include "palpate/surfaces/surfaces.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <memory>
#include <sstream>

#include "surfaces/surface_net.h"
#include "surfaces/surface_net_distance.h"
#include "surfaces/surface_slopes.h"
#include "surfaces/surface_stages.h"

namespace palpate {

namespace {

using internal::Component;
using internal::Components;
using internal::full_span;
using internal::LabelRun;
using internal::PieceMargins;
using internal::ProgressSpan;
using internal::Span3;
using internal::StepsSource;
using internal::SurfacePlan;
using internal::SurfaceStage;
using internal::SurfaceStages;
using internal::to_box;
using internal::to_span;

Error out_of_range(const char* name, double value, const char* range) {
  std::ostringstream what;
  what << name << " is " << value;
  return {ErrorKind::kBadInput, what.str(), "", range};
}

Result<void> check(const SurfaceOptions& o) {
  if (!(o.reach_mm >= 1 && o.reach_mm <= kMaxSurfaceReach_mm)) {
    return out_of_range("the reach of a surface in mm", o.reach_mm, "give 1 to 15 mm");
  }
  if (!(o.position_sigma_mm >= 0 && o.position_sigma_mm <= 3)) {
    return out_of_range("sigma of a surface's position in mm", o.position_sigma_mm, "give 0 to 3 mm");
  }
  if (!(o.normal_sigma_mm >= 0.5 && o.normal_sigma_mm <= 5)) {
    return out_of_range("sigma of a surface's normal in mm", o.normal_sigma_mm, "give 0.5 to 5 mm");
  }
  for (const double volume_mm3 : {o.stray_below_mm3, o.drop_below_mm3}) {
    if (!(volume_mm3 >= 0 && std::isfinite(volume_mm3))) {
      return out_of_range("the volume of a stray component in mm3", volume_mm3, "give 0 or more");
    }
  }
  if (o.threads < 0) {
    return out_of_range("the number of threads", o.threads, "give 0 for all processors, or at least 1");
  }
  return {};
}

Error no_voxels(LabelId label, const char* why) {
  return {ErrorKind::kBadInput, "label " + std::to_string(label) + why, "", "choose labels of the volume"};
}

StrayComponent to_stray(const Component& c, const GridGeometry& grid) {
  StrayComponent stray;
  stray.voxels = c.voxels;
  stray.volume_mm3 = static_cast<double>(c.voxels) * grid.voxel_volume_mm3();
  stray.box = to_box(c.span);
  stray.centroid = grid.X_PatientVoxel() * Point<Voxel>(c.index_sum / static_cast<double>(c.voxels));
  return stray;
}

/// Components of a structure, divided into retained and dropped ones.
struct Sorted {
  std::size_t voxels = 0;  ///< Voxels of retained components
  Span3 extent;            ///< Bounding box of retained components
  std::vector<LabelRun> dropped;
  std::vector<StrayComponent> strays;
};

Sorted sort_components(const Components& components, const GridGeometry& grid,
                       const SurfaceOptions& options) {
  Sorted sorted;
  std::vector<char> dropped;
  for (const Component& c : components.all) {
    StrayComponent stray = to_stray(c, grid);
    stray.dropped = stray.volume_mm3 < options.drop_below_mm3;
    dropped.push_back(stray.dropped ? 1 : 0);
    if (stray.dropped || stray.volume_mm3 < options.stray_below_mm3) sorted.strays.push_back(stray);
    if (stray.dropped) continue;
    for (int a = 0; a < 3; ++a) {
      const bool fresh = sorted.voxels == 0;
      sorted.extent.low[a] = fresh ? c.span.low[a] : std::min(sorted.extent.low[a], c.span.low[a]);
      sorted.extent.high[a] = fresh ? c.span.high[a] : std::max(sorted.extent.high[a], c.span.high[a]);
    }
    sorted.voxels += c.voxels;
  }
  std::stable_sort(sorted.strays.begin(), sorted.strays.end(),
                   [](const StrayComponent& a, const StrayComponent& b) { return a.voxels < b.voxels; });
  for (const LabelRun& run : components.runs) {
    if (dropped[run.component] != 0) sorted.dropped.push_back(run);
  }
  return sorted;
}

SignedField to_field(Bricks<std::int16_t> steps, double outside_mm) {
  return {std::move(steps),
          {.scale = kSurfaceStep_mm, .offset = 0, .outside = internal::to_steps(outside_mm)}};
}

/// Runs all stages over a structure's whole box, without storing any field densely.
class WholeSurface {
 public:
  WholeSurface(const SurfacePlan& plan, const Progress& progress, const ProgressSpan& span)
      : plan_(plan), progress_(progress), span_(span) {}

  Result<void> build(const Bricks<LabelId>& labels, const std::vector<LabelRun>& without,
                     PreparedSurface& prepared) {
    using Target = internal::Target<std::int16_t>;
    const Span3 fine = full_span(plan_.fine);
    SurfaceIntermediates& w = prepared.intermediates;

    auto done = make_bricks(
        plan_.fine, plan_.reach_mm,
        [&](const Target& out) { return stages_.distance(labels, prepared.label, without, out); }, 0, 0.1,
        w.distance);
    if (!done) return done;
    const auto distance = StepsSource::of(w.distance);

    // the filtered labels are only used to build the net and are not stored
    auto net =
        std::make_shared<internal::SurfaceNet>(internal::empty_net(internal::cells_of(fine), plan_.fine));
    done = make_net(distance, *net);
    if (!done) return done;
    const internal::Index3& first = plan_.box.first;
    Span3 volume = full_span(labels.geometry());
    for (int a = 0; a < 3; ++a) {
      volume.low[a] -= first[a];
      volume.high[a] -= first[a];
    }
    done =
        internal::relax_net(*net, internal::cells_of(volume), plan_.threads, progress_, span_.part(0.2, 0.7));
    if (!done) return done;
    w.net = net;

    Bricks<std::int16_t> position;
    {
      const internal::NetTriangles triangles(*net, net->cells);
      done = make_bricks(
          plan_.fine, plan_.reach_mm,
          [&](const Target& out) { return stages_.position(triangles, distance, out); }, 0.7, 0.9, position);
      if (!done) return done;
    }
    const auto source = StepsSource::of(position);

    const GridGeometry& normal_grid = plan_.normal.geometry;
    done = make_bricks(
        normal_grid, plan_.broad_reach_mm, [&](const Target& out) { return stages_.broad(source, out); }, 0.9,
        0.94, w.broad);
    if (!done) return done;
    Bricks<std::int16_t> normal;
    done = make_bricks(
        normal_grid, plan_.broad_reach_mm,
        [&](const Target& out) { return stages_.normal(StepsSource::of(w.broad), source, out); }, 0.94, 0.98,
        normal);
    if (!done) return done;

    const Span3 stretches = internal::stretches(plan_.fine);
    w.slopes.resize(stretches.count());
    const SurfaceStage slopes = stages_.slopes(source, {w.slopes.data(), stretches});
    done = stages_.run_in_pieces(slopes, progress_, span_.part(0.98, 1));
    if (!done) return done;

    prepared.surface = Surface(to_field(std::move(position), plan_.reach_mm),
                               to_field(std::move(normal), plan_.broad_reach_mm),
                               internal::steepest_of(internal::greatest(w.slopes)));
    return {};
  }

 private:
  /// Runs a stage over a grid, some slices at a time.
  /// @param stage_of  creates the stage that writes to a target
  /// @param visit      called with each range of slices, in order, when values_ holds it
  template <class StageOf, class Take>
  Result<void> by_slices(const Span3& all, const StageOf& stage_of, double from, double to,
                         const Take& visit) {
    if (all.empty()) return {};
    Span3 part = all;
    for (int k = all.low[2]; k < all.high[2]; k = part.high[2]) {
      part.low[2] = k;
      part.high[2] = all.high[2];
      // margins do not depend on the target
      const PieceMargins margins = stage_of(internal::Target<std::int16_t>{nullptr, part}).margins;
      part.high[2] = std::min(all.high[2], k + internal::slices_at_a_time(all, margins, plan_.threads));
      values_.resize(part.count());
      const auto at = [&](int slice) { return from + (to - from) * (slice - all.low[2]) / all.size(2); };
      const auto done = stages_.run_in_pieces(stage_of(internal::Target<std::int16_t>{values_.data(), part}),
                                              progress_, span_.part(at(part.low[2]), at(part.high[2])));
      if (!done) return done;
      visit(part);
    }
    return {};
  }

  template <class StageOf>
  Result<void> make_bricks(const GridGeometry& grid, double outside_mm, const StageOf& stage_of, double from,
                           double to, Bricks<std::int16_t>& made) {
    BricksBySlices<std::int16_t> bricks(grid, internal::to_steps(outside_mm));
    const auto done = by_slices(full_span(grid), stage_of, from, to,
                                [&](const Span3& part) { bricks.add(part.size(2), values_.data()); });
    if (!done) return done;
    made = bricks.take();
    return {};
  }

  /// Cells between two batches need slices of both.
  Result<void> make_net(const StepsSource& distance, internal::SurfaceNet& net) {
    const Span3 fine = full_span(plan_.fine);
    const auto row = static_cast<std::size_t>(fine.size(0)),
               slice = row * static_cast<std::size_t>(fine.size(1));
    std::vector<std::int16_t> last;
    const auto add = [&](const Span3& part) {
      const auto row_at = [&](int j, int k) {
        const std::size_t at = row * static_cast<std::size_t>(j);
        return k < part.low[2] ? last.data() + at
                               : values_.data() + slice * static_cast<std::size_t>(k - part.low[2]) + at;
      };
      Span3 voxels = part;
      if (!last.empty()) --voxels.low[2];
      internal::append_net(internal::make_net(row_at, internal::cells_of(voxels), plan_.fine.spacing_mm),
                           net);
      last.assign(values_.end() - static_cast<std::ptrdiff_t>(slice), values_.end());
    };
    return by_slices(
        fine, [&](const internal::Target<std::int16_t>& out) { return stages_.crossings(distance, out); },
        0.1, 0.2, add);
  }

  const SurfacePlan& plan_;
  SurfaceStages stages_{plan_};
  const Progress& progress_;
  ProgressSpan span_;
  std::vector<std::int16_t> values_;
};

Result<PreparedSurface> prepare(const Bricks<LabelId>& labels, LabelId label, const Span3& span_of_label,
                                const SurfaceOptions& options, const Progress& progress,
                                const ProgressSpan& span) {
  const GridGeometry& grid = labels.geometry();
  const Components components = internal::find_components(labels, label, span_of_label);
  const Sorted sorted = sort_components(components, grid, options);
  if (sorted.voxels == 0) return no_voxels(label, " has no component that is large enough");

  PreparedSurface prepared;
  prepared.label = label;
  prepared.options = options;
  prepared.volume_mm3 = static_cast<double>(sorted.voxels) * grid.voxel_volume_mm3();
  prepared.components = static_cast<int>(components.all.size());
  prepared.strays = sorted.strays;
  prepared.intermediates.extent = to_box(sorted.extent);
  prepared.box = to_box(sorted.extent.grown(SurfacePlan::margin(grid, options)));
  try {
    const SurfacePlan plan(grid, prepared.box, options);
    const auto done = WholeSurface(plan, progress, span).build(labels, sorted.dropped, prepared);
    if (!done) return done.error();
  } catch (const std::bad_alloc&) {
    return Error{ErrorKind::kBadInput, "not enough memory for the surface of label " + std::to_string(label),
                 "", "close other programs, or crop the volume"};
  }
  return prepared;
}

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

Result<void> prepare_each_surface(const Bricks<LabelId>& labels, const std::vector<LabelId>& structures,
                                  const SurfaceOptions& options,
                                  const std::function<void(PreparedSurface)>& visit,
                                  const Progress& progress) {
  const auto checked = check(options);
  if (!checked) return checked.error();
  const std::vector<Span3> spans = internal::label_spans(labels);
  for (const LabelId label : structures) {
    if (label == 0) return no_voxels(label, " is the background");
    if (spans[label].empty()) return no_voxels(label, " has no voxels");
  }

  const ProgressSpan whole_work{"preparing surfaces"};
  const auto count = static_cast<double>(structures.size());
  double n = 0;
  for (const LabelId label : structures) {
    auto one =
        prepare(labels, label, spans[label], options, progress, whole_work.part(n / count, (n + 1) / count));
    if (!one) return one.error();
    visit(*std::move(one));
    ++n;
  }
  return {};
}

Result<std::vector<PreparedSurface>> prepare_surfaces(const Bricks<LabelId>& labels,
                                                      const std::vector<LabelId>& structures,
                                                      const SurfaceOptions& options,
                                                      const Progress& progress) {
  std::vector<PreparedSurface> all;
  const auto visit = [&](PreparedSurface one) { all.push_back(std::move(one)); };
  const auto done = prepare_each_surface(labels, structures, options, visit, progress);
  if (!done) return done.error();
  return all;
}

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
  const Bricks<std::int16_t>& was = old.surface.position().bricks();
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
  const GridGeometry& fine = old.surface.position().geometry();
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
