#include "surfaces/surface_stages.h"

#include <algorithm>
#include <cmath>
#include <new>

#include "surfaces/signed_distance.h"
#include "surfaces/surface_rows.h"
#include "surfaces/surface_slopes.h"

namespace palpate::internal {

namespace {

GridGeometry part_of(const GridGeometry& grid, const VoxelBox& box) {
  GridGeometry part = grid;
  part.dims = box.size;
  part.origin = grid.X_PatientVoxel() * Point<Voxel>(box.first[0], box.first[1], box.first[2]);
  return part;
}

/// Result of gather() in mm, clamped to +-limit_mm, which is also the value outside.
Block<float> gather_mm(const StepsSource& source, const Index3& step, const Span3& span, double limit_mm) {
  const Block<std::int16_t> steps = gather(source, step, span, to_steps(limit_mm));
  Block<float> mm(span);
  steps_to_mm(steps.values().data(), steps.values().size(), static_cast<float>(limit_mm), mm.values().data());
  return mm;
}

template <class T>
void put(const Block<T>& block, const Target<T>& out) {
  const auto length = static_cast<std::ptrdiff_t>(block.span().size(0));
  for_each_row(block.span(), [&](int j, int k) {
    const std::ptrdiff_t row = std::ptrdiff_t{k - out.span.low[2]} * out.span.size(1) + (j - out.span.low[1]);
    std::copy_n(block.row(j, k), length,
                out.values + row * out.span.size(0) + (block.span().low[0] - out.span.low[0]));
  });
}

/// Mask of a box: 1 where the voxel has the label and is in no excluded run.
Block<std::uint8_t> mask_of(const Bricks<LabelId>& labels, LabelId label,
                            const std::vector<LabelRun>& without, const Span3& span, const VoxelBox& box) {
  Block<std::uint8_t> mask(span, 0);
  const Span3 there{{span.low[0] + box.first[0], span.low[1] + box.first[1], span.low[2] + box.first[2]},
                    {span.high[0] + box.first[0], span.high[1] + box.first[1], span.high[2] + box.first[2]}};
  const Span3 known = there.clipped(full_span(labels.geometry()));
  const auto row_of = [&](int j, int k) {
    return mask.row(j - box.first[1], k - box.first[2]) - there.low[0];
  };
  for_each_row(labels, known, [&](int j, int k, const LabelId* from) {
    std::uint8_t* to = row_of(j, k) + known.low[0];
    for (int i = 0; i < known.size(0); ++i) to[i] = from[i] == label ? 1 : 0;
  });
  for (const LabelRun& run : without) {
    const Span3 removed =
        Span3{{run.first, run.j, run.k}, {run.last + 1, run.j + 1, run.k + 1}}.clipped(known);
    if (!removed.empty())
      std::fill(row_of(run.j, run.k) + removed.low[0], row_of(run.j, run.k) + removed.high[0], 0);
  }
  return mask;
}

/// Writes the distance to the nearest triangle in steps, with the sign of a field, where requested.
void put_signed_distance(const NetTriangles& net, const Block<std::int16_t>& sign, double reach_mm,
                         const Block<std::uint8_t>& requested, Block<std::int16_t>& steps) {
  Block<float> mm(sign.span(), 0);
  net.distance(static_cast<float>(reach_mm), requested, mm);
  Block<std::int16_t> found(sign.span());
  mm_to_steps(mm.values().data(), mm.values().size(), found.values().data());
  for_each_row(steps.span(), [&](int j, int k) {
    const std::uint8_t* is_requested = requested.row(j, k) + (steps.span().low[0] - requested.span().low[0]);
    for (int x = 0; x < steps.span().size(0); ++x) {
      if (is_requested[x] == 0) continue;
      // no voxel lies exactly on the surface: its sign is the label
      const int size = std::max<int>(1, found.row(j, k)[x]);
      steps.row(j, k)[x] = static_cast<std::int16_t>(sign.row(j, k)[x] < 0 ? -size : size);
    }
  });
}

constexpr Index3 kEvery{1, 1, 1};
// cost of bounding a voxel's slope relative to filtering it, measured
constexpr double kSlopeCost = 0.15;

}  // namespace

Block<std::int16_t> gather(const StepsSource& source, const Index3& step, const Span3& span,
                           std::int16_t outside) {
  Block<std::int16_t> block(span, outside);
  // points of the coarse grid inside a box of fine voxels
  const auto coarse = [&](const Span3& fine) {
    Span3 s;
    for (int a = 0; a < 3; ++a) {
      s.low[a] = (fine.low[a] + step[a] - 1) / step[a];
      s.high[a] = (fine.high[a] + step[a] - 1) / step[a];
    }
    return s.clipped(span);
  };
  const auto copy = [&](const Span3& fine, const auto& row_of) {
    const Span3 part = coarse(fine);
    for_each_row(part, [&](int j, int k) {
      const std::int16_t* from =
          row_of(part.low[0] * step[0], j * step[1], k * step[2], (part.size(0) - 1) * step[0] + 1);
      std::int16_t* to = block.row(j, k) + (part.low[0] - span.low[0]);
      const auto count = static_cast<std::size_t>(part.size(0));
      if (step[0] == 1) {
        std::copy_n(from, count, to);
      } else {
        take_every(from, static_cast<std::size_t>(step[0]), count, to);
      }
    });
  };
  std::vector<std::int16_t> row(static_cast<std::size_t>(source.bricks->geometry().dims[0]));
  copy(full_span(source.bricks->geometry()), [&](int i, int j, int k, int count) {
    source.bricks->copy_row(i, j, k, count, row.data());
    return row.data();
  });
  if (source.over != nullptr) {
    const auto& [box, values] = *source.over;
    // clang 14 cannot capture structured bindings by reference
    copy(to_span(box), [&box = box, &values = values](int i, int j, int k, int) {
      return values.data() +
             (std::ptrdiff_t{k - box.first[2]} * box.size[1] + (j - box.first[1])) * box.size[0] +
             (i - box.first[0]);
    });
  }
  return block;
}

SurfacePlan::SurfacePlan(const GridGeometry& labels, const VoxelBox& structure_box,
                         const SurfaceOptions& options)
    : box(structure_box),
      fine(part_of(labels, structure_box)),
      normal(fine),
      reach_mm(options.reach_mm),
      broad_reach_mm(std::min(options.reach_mm, kBroadReach_mm)),
      window(distance_window(fine.spacing_mm, reach_mm)),
      broad_window(distance_window(fine.spacing_mm, broad_reach_mm)),
      position_filter(fine.spacing_mm, options.position_sigma_mm),
      broad_filter(normal.geometry.spacing_mm, options.normal_sigma_mm),
      normal_filter(normal.geometry.spacing_mm, options.normal_sigma_mm),
      threads(options.threads) {}

Index3 SurfacePlan::margin(const GridGeometry& labels, const SurfaceOptions& options) {
  const Index3 window = distance_window(labels.spacing_mm, options.reach_mm);
  const Index3 smooth = PositionFilter(labels.spacing_mm, options.position_sigma_mm).smooth.reach();
  return {window[0] + smooth[0] + 1, window[1] + smooth[1] + 1, window[2] + smooth[2] + 1};
}

namespace {

/// Number of slabs of each stage when the most expensive one is cut into `max_value`.
std::vector<int> slab_counts(std::span<const SurfaceStage> stages, int max_value) {
  double largest = 0;
  for (const SurfaceStage& stage : stages) largest = std::max(largest, stage.total_cost());
  std::vector<int> counts;
  for (const SurfaceStage& stage : stages) {
    const auto fraction = static_cast<int>(std::lround(max_value * stage.total_cost() / largest));
    counts.push_back(std::clamp(fraction, 1, std::max(1, stage.part.size(2))));
  }
  return counts;
}

/// Time at which the last worker finishes, if each takes the next slab when idle.
double end_of(std::span<const SurfaceStage> stages, const std::vector<int>& counts, int workers) {
  std::vector<double> busy(static_cast<std::size_t>(workers), 0.0);
  for (std::size_t n = 0; n < stages.size(); ++n) {
    for (int slab = 0; slab < counts[n]; ++slab)
      *std::min_element(busy.begin(), busy.end()) += stages[n].total_cost() / counts[n];
  }
  return *std::max_element(busy.begin(), busy.end());
}

/// Smallest numbers of slabs that let all workers finish together; each slab has margins.
std::vector<int> balanced_slab_counts(std::span<const SurfaceStage> stages, int workers) {
  std::vector<int> best = slab_counts(stages, workers);
  for (int largest = workers + 1; largest < 2 * workers; ++largest) {
    std::vector<int> counts = slab_counts(stages, largest);
    if (end_of(stages, counts, workers) < end_of(stages, best, workers)) best = std::move(counts);
  }
  return best;
}

struct Slab {
  const SurfaceStage* stage;
  Span3 span;
};

Result<void> work_on(const std::vector<Slab>& slabs, int workers, const Progress& progress,
                     const ProgressSpan& span) {
  std::atomic<bool> no_memory{false};
  const auto count = static_cast<int>(slabs.size());
  const auto done = for_each_slice(count, std::min(workers, count), progress, span, [&](int, int n) {
    try {
      const Slab& slab = slabs[static_cast<std::size_t>(n)];
      slab.stage->work(slab.span);
    } catch (const std::bad_alloc&) {
      no_memory = true;
    }
  });
  if (!done) return done.error();
  if (no_memory) {
    return Error{ErrorKind::kBadInput, "not enough memory to prepare a surface", "",
                 "close other programs, crop the volume, or prepare with fewer threads"};
  }
  return {};
}

}  // namespace

Result<void> SurfaceStages::run(std::span<const SurfaceStage> stages, const Progress& progress,
                                const ProgressSpan& span) const {
  int slices = 0;
  for (const SurfaceStage& stage : stages) {
    if (!stage.part.empty()) slices = std::max(slices, stage.part.size(2));
  }
  if (slices == 0) return {};
  std::vector<Slab> slabs;
  const int workers = worker_count(plan.threads, slices);
  const std::vector<int> counts = balanced_slab_counts(stages, workers);
  for (std::size_t n = 0; n < stages.size(); ++n) {
    const Span3& part = stages[n].part;
    if (part.empty()) continue;
    const int thick = (part.size(2) + counts[n] - 1) / counts[n];
    for (int k = part.low[2]; k < part.high[2]; k += thick) {
      Slab slab{&stages[n], part};
      slab.span.low[2] = k;
      slab.span.high[2] = std::min(part.high[2], k + thick);
      slabs.push_back(slab);
    }
  }
  return work_on(slabs, workers, progress, span);
}

Result<void> SurfaceStages::run_in_pieces(const SurfaceStage& stage, const Progress& progress,
                                          const ProgressSpan& span) const {
  const Pieces pieces = cut_into_pieces(stage.part, stage.margins, plan.threads);
  std::vector<Slab> slabs;
  for (const Span3& piece : pieces.all) slabs.push_back({&stage, piece});
  return slabs.empty() ? Result<void>() : work_on(slabs, pieces.workers, progress, span);
}

SurfaceStage SurfaceStages::distance(const Bricks<LabelId>& labels, LabelId label,
                                     const std::vector<LabelRun>& without,
                                     const Target<std::int16_t>& out) const {
  return {out.span,
          [&labels, label, &without, out, this](const Span3& slab) {
            Block<float> mm(slab);
            signed_distance(mask_of(labels, label, without, slab.grown(plan.window), plan.box),
                            plan.fine.spacing_mm, plan.reach_mm, mm);
            Block<std::int16_t> steps(slab);
            mm_to_steps(mm.values().data(), mm.values().size(), steps.values().data());
            put(steps, out);
          },
          {{0, 0, 0}, plan.window}};
}

SurfaceStage SurfaceStages::crossings(const StepsSource& distance, const Target<std::int16_t>& out) const {
  return {out.span,
          [distance, out, this](const Span3& slab) {
            Block<std::int16_t> steps(slab);
            plan.position_filter.apply(
                gather_mm(distance, kEvery, slab.grown(plan.position_filter.reach()), plan.reach_mm), steps);
            put(steps, out);
          },
          {plan.position_filter.reach(), {0, 0, 0}}};
}

SurfaceStage SurfaceStages::position(const NetTriangles& net, const StepsSource& distance,
                                     const Target<std::int16_t>& out) const {
  return {out.span, [&net, distance, out, this](const Span3& slab) {
            Block<std::int16_t> steps(slab);
            put_signed_distance(net, gather(distance, kEvery, slab, 1), plan.reach_mm, {slab, 1}, steps);
            put(steps, out);
          }};
}

SurfaceStage SurfaceStages::stale(const Block<std::uint8_t>& corners, const StepsSource& was,
                                  const Target<std::uint8_t>& out) const {
  return {out.span, [&corners, was, out, this](const Span3& slab) {
            // the point of a cell nearest to a voxel is one of its corners
            Block<float> separation_mm(slab, 0);
            distance_to_class(corners, 1, plan.fine.spacing_mm, plan.reach_mm, separation_mm);
            const Block<std::int16_t> before = gather(was, kEvery, slab, 0);
            Block<std::uint8_t> stale(slab);
            const auto reach = static_cast<float>(plan.reach_mm), step = static_cast<float>(kSurfaceStep_mm);
            for (std::size_t n = 0; n < stale.values().size(); ++n) {
              const float separation = separation_mm.values()[n];
              const auto nearest = static_cast<float>(std::abs(before.values()[n]) + 1) * step;
              stale.values()[n] = separation < reach && nearest >= separation ? 1 : 0;
            }
            put(stale, out);
          }};
}

SurfaceStage SurfaceStages::updated_position(const NetTriangles& net, const StepsSource& distance,
                                             const StepsSource& was, const Block<std::uint8_t>& stale,
                                             const Target<std::int16_t>& out) const {
  return {out.span, [&net, distance, was, &stale, out, this](const Span3& slab) {
            Block<std::int16_t> steps = gather(was, kEvery, slab, 0);
            put_signed_distance(net, gather(distance, kEvery, slab, 1), plan.reach_mm, stale, steps);
            put(steps, out);
          }};
}

SurfaceStage SurfaceStages::broad(const StepsSource& position, const Target<std::int16_t>& out) const {
  return {out.span,
          [position, out, this](const Span3& slab) {
            Block<std::int16_t> steps(slab);
            plan.broad_filter.apply(gather_mm(position, plan.normal.step,
                                              slab.grown(plan.broad_filter.reach()), plan.broad_reach_mm),
                                    steps);
            put(steps, out);
          },
          {plan.broad_filter.reach(), {0, 0, 0}}};
}

SurfaceStage SurfaceStages::normal(const StepsSource& broad, const StepsSource& position,
                                   const Target<std::int16_t>& out) const {
  return {out.span,
          [broad, position, out, this](const Span3& slab) {
            const Span3 around = slab.grown(plan.normal_filter.reach());
            Block<std::int16_t> steps(slab);
            plan.normal_filter.apply(gather_mm(broad, kEvery, around, plan.broad_reach_mm),
                                     gather_mm(position, plan.normal.step, around, plan.reach_mm), steps);
            put(steps, out);
          },
          {plan.normal_filter.reach(), {0, 0, 0}}};
}

SurfaceStage SurfaceStages::slopes(const StepsSource& position, const Target<float>& out) const {
  return {out.span,
          [position, out, this](const Span3& slab) {
            Span3 voxels = slab;
            voxels.low[0] = slab.low[0] * kStretch;
            voxels.high[0] = slab.high[0] * kStretch;
            for (int& high : voxels.high) ++high;
            voxels = voxels.clipped(full_span(plan.fine));
            Block<float> squares(slab);
            bound_slopes(plan.fine, gather(position, kEvery, voxels, 0), squares);
            put(squares, out);
          },
          {},
          kStretch * kSlopeCost};
}

}  // namespace palpate::internal
