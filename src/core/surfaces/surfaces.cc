#include "palpate/surfaces/surfaces.h"

#include <algorithm>
#include <cmath>
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
  /// @param visit     called with each range of slices, in order, when values_ holds it
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
    BricksBuilder<std::int16_t> bricks(grid, internal::to_steps(outside_mm));
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

}  // namespace palpate
