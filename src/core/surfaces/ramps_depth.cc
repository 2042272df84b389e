#include "surfaces/ramps_depth.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <new>

#include "surfaces/pieces.h"
#include "surfaces/signed_distance.h"

namespace palpate::internal {

namespace {

/// Calls work(worker, piece) for all pieces.
Result<void> by_pieces(const Pieces& pieces, const Progress& progress, const ProgressSpan& stage,
                       const std::function<void(int worker, const Span3& piece)>& work) {
  std::atomic<bool> no_memory{false};
  const auto done = for_each_slice(static_cast<int>(pieces.all.size()), pieces.workers, progress, stage,
                                   [&](int worker, int n) {
                                     try {
                                       work(worker, pieces.all[static_cast<std::size_t>(n)]);
                                     } catch (const std::bad_alloc&) {
                                       no_memory = true;
                                     }
                                   });
  if (!done) return done;
  if (no_memory) {
    return Error{ErrorKind::kBadInput, "not enough memory to prepare the ramps", "",
                 "close other programs, or crop the volume"};
  }
  return {};
}

/// Mask of a box: 1 where the voxel's label is in the set.
Block<std::uint8_t> mask_of(const Bricks<LabelId>& labels, const std::vector<LabelId>& set,
                            const Span3& span) {
  Block<std::uint8_t> mask(span, 0);
  const Span3 known = span.clipped(full_span(labels.geometry()));
  const int length = known.size(0);
  for_each_row(labels, known, [&](int j, int k, const LabelId* from) {
    std::uint8_t* to = mask.row(j, k) + (known.low[0] - span.low[0]);
    for (const LabelId label : set) {
      for (int i = 0; i < length; ++i) to[i] = static_cast<std::uint8_t>(to[i] | (from[i] == label ? 1 : 0));
    }
  });
  return mask;
}

/// Reach inside the set, far enough that its cutoff hardly affects the filter; slightly less than 16 mm at
/// most.
double inside_reach_mm(const DepthOptions& options) {
  return options.reach_mm + 2 * options.sigma_mm;
}

/// Reach outside the set: the radius of the filter of an inside voxel.
double outside_reach_mm(const DepthOptions& options) {
  constexpr double kCutSigmasOfFilter = 3, kBesides_mm = 1;
  return std::min(options.reach_mm, kCutSigmasOfFilter * options.sigma_mm + kBesides_mm);
}

}  // namespace

Index3 position_window(const Eigen::Vector3d& spacing_mm, const DepthOptions& options) {
  const Index3 near = PositionFilter(spacing_mm, options.sigma_mm).reach();
  const Index3 far = distance_window(spacing_mm, inside_reach_mm(options));
  return {near[0] + far[0], near[1] + far[1], near[2] + far[2]};
}

Result<Bricks<std::int16_t>> set_position(const Bricks<LabelId>& labels, const std::vector<LabelId>& set,
                                          const DepthOptions& options, const Progress& progress,
                                          const ProgressSpan& stage, const Span3& span) {
  GridGeometry grid = labels.geometry();
  grid.dims = {span.size(0), span.size(1), span.size(2)};
  const PositionFilter filter(grid.spacing_mm, options.sigma_mm);
  const double inside_mm = inside_reach_mm(options), outside_mm = outside_reach_mm(options);
  const Index3 window = distance_window(grid.spacing_mm, inside_mm);
  const PieceMargins margins{filter.reach(), window};
  BricksBuilder<std::int16_t> position(grid, 0);
  const int slices = slices_at_a_time(span, margins, options.threads);
  Span3 part = span;
  for (int k = span.low[2]; k < span.high[2]; k = part.high[2]) {
    part.low[2] = k;
    part.high[2] = std::min(span.high[2], k + slices);
    Block<std::int16_t> here(part);
    const auto at = [&](int slice) { return static_cast<double>(slice - span.low[2]) / span.size(2); };
    const auto work = [&](int, const Span3& slab) {
      const Span3 around = slab.grown(filter.reach());
      Block<float> distance(around);
      const Block<std::uint8_t> mask = mask_of(labels, set, around.grown(window));
      distance_to_class(mask, 0, grid.spacing_mm, inside_mm, distance);
      distance_to_class(mask, 1, grid.spacing_mm, outside_mm, distance);
      Block<std::int16_t> made(slab);
      filter.apply(distance, made);
      const auto length = static_cast<std::size_t>(slab.size(0));
      for_each_row(slab, [&](int j, int l) { std::copy_n(made.row(j, l), length, here.row(j, l)); });
    };
    const auto done = by_pieces(cut_into_pieces(part, margins, options.threads), progress,
                                stage.part(at(part.low[2]), at(part.high[2])), work);
    if (!done) return done.error();
    position.add(part.size(2), here.values().data());
  }
  return position.take();
}

Result<double> median_half_thickness_mm(const Bricks<LabelId>& labels, LabelId label, const Span3& span,
                                        double reach_mm, int threads, const Progress& progress,
                                        const ProgressSpan& stage) {
  const Eigen::Vector3d& spacing_mm = labels.geometry().spacing_mm;
  const Index3 window = distance_window(spacing_mm, reach_mm);
  // histogram of distances, in thousandths of the reach
  constexpr int kBins = 1000;
  using Counts = std::array<std::size_t, kBins + 1>;
  const Pieces pieces = cut_into_pieces(span, {{1, 1, 1}, window}, threads);
  std::vector<Counts> counts(static_cast<std::size_t>(pieces.workers), Counts{});
  const auto done = by_pieces(pieces, progress, stage, [&](int worker, const Span3& slab) {
    Counts& mine = counts[static_cast<std::size_t>(worker)];
    const Span3 around = slab.grown({1, 1, 1});
    Block<float> distance(around, 0);
    distance_to_class(mask_of(labels, {label}, around.grown(window)), 0, spacing_mm, reach_mm, distance);
    for_each_row(slab, [&](int j, int k) {
      const float* rows[9];
      for (int n = 0; n < 9; ++n)
        rows[n] = distance.row(j + n % 3 - 1, k + n / 3 - 1) + (slab.low[0] - around.low[0]);
      for (int i = 0; i < slab.size(0); ++i) {
        const float here = rows[4][i];
        if (here >= 0) continue;
        // negative inside: no neighbour is deeper
        const bool ridge = std::all_of(rows, rows + 9, [&](const float* row) {
          return row[i - 1] >= here && row[i] >= here && row[i + 1] >= here;
        });
        if (ridge) ++mine[static_cast<std::size_t>(std::lround(kBins * -here / reach_mm))];
      }
    });
  });
  if (!done) return done.error();
  std::size_t all = 0;
  for (const Counts& some : counts)
    for (const std::size_t n : some) all += n;
  std::size_t below = 0;
  for (int bin = 0; bin <= kBins; ++bin) {
    for (const Counts& some : counts) below += some[static_cast<std::size_t>(bin)];
    if (2 * below >= all) return reach_mm * bin / kBins;
  }
  return reach_mm;
}

}  // namespace palpate::internal
