#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>

#include "lint/lint_context.h"
#include "lint/voxel_bits.h"
#include "palpate/volume/resample.h"

/// Checks of the space around structures: gaps, access of the tool, air.
namespace palpate::internal {
namespace {

constexpr double kGap_mm2 = 20;
// minimum fraction of the neighbouring columns, up to this number of voxels to each side, that must be in
// the gap as well; a crevice along a line of contact is narrower
constexpr int kGapLateral = 2;
constexpr double kGapFilled = 0.6;

/// A run of free voxels between two labels along an axis.
struct GapSpan {
  std::array<int, 3> first;
  std::uint8_t axis;
  int length;
  LabelId a, b;

  std::array<int, 3> middle() const {
    std::array<int, 3> at = first;
    at[axis] += (length - 1) / 2;
    return at;
  }
};

/// Scans successive rows of voxels along one axis for gaps of at most `max_gap` voxels.
class GapScan {
 public:
  GapScan(int lines, int max_gap) : last_(static_cast<std::size_t>(lines)), max_gap_(max_gap) { restart(); }

  void restart() { std::ranges::fill(last_, Last{}); }

  template <class Take>
  void look(int position, const LabelId* values, const Take& visit) {
    for (std::size_t i = 0; i < last_.size(); ++i) {
      const LabelId value = values[i];
      if (value == 0) continue;
      Last& last = last_[i];
      const int gap = position - last.position - 1;
      if (gap > 0 && gap <= max_gap_ && last.value != 0) visit(static_cast<int>(i), gap, last.value, value);
      last = {position, value};
    }
  }

 private:
  struct Last {
    int position = 0;
    LabelId value = 0;
  };
  std::vector<Last> last_;
  int max_gap_;
};

/// Length in voxels of the longest free run that is narrower than the tool.
int longest_gap(double tool_radius_mm, double spacing_mm) {
  return static_cast<int>(std::ceil(2 * tool_radius_mm / spacing_mm - 1e-9)) - 1;
}

Result<std::vector<GapSpan>> find_spans(LintContext& context, const Volume<LabelId>& flat,
                                        const ProgressSpan& span) {
  const auto& dims = context.grid.dims;
  std::array<int, 3> most;
  for (std::size_t a = 0; a < 3; ++a)
    most[a] =
        longest_gap(context.options.tool_radius_mm, context.grid.spacing_mm[static_cast<Eigen::Index>(a)]);
  const auto row = [&](int j, int k) { return flat.voxels().data() + context.grid.offset(0, j, k); };
  std::vector<std::vector<GapSpan>> found(static_cast<std::size_t>(context.workers));
  const auto slices =
      for_each_slice(dims[2], context.workers, context.progress, span.part(0, 0.5), [&](int worker, int k) {
        auto& out = found[static_cast<std::size_t>(worker)];
        GapScan along_j(dims[0], most[1]);
        for (int j = 0; j < dims[1]; ++j) {
          const LabelId* values = row(j, k);
          if (most[1] > 0)
            along_j.look(j, values, [&](int i, int gap, LabelId a, LabelId b) {
              out.push_back({{i, j - gap, k}, 1, gap, a, b});
            });
          if (most[0] <= 0) continue;
          int last = -1;
          for (int i = 0; i < dims[0]; ++i) {
            if (values[i] == 0) continue;
            const int gap = i - last - 1;
            if (last >= 0 && gap > 0 && gap <= most[0])
              out.push_back({{i - gap, j, k}, 0, gap, values[last], values[i]});
            last = i;
          }
        }
      });
  if (!slices) return slices.error();
  if (most[2] > 0) {
    const auto rows =
        for_each_slice(dims[1], std::min(context.workers, dims[1]), context.progress, span.part(0.5, 1),
                       [&](int worker, int j) {
                         auto& out = found[static_cast<std::size_t>(worker)];
                         GapScan along_k(dims[0], most[2]);
                         for (int k = 0; k < dims[2]; ++k)
                           along_k.look(k, row(j, k), [&](int i, int gap, LabelId a, LabelId b) {
                             out.push_back({{i, j, k - gap}, 2, gap, a, b});
                           });
                       });
    if (!rows) return rows.error();
  }
  std::vector<GapSpan> all;
  for (const auto& mine : found) all.insert(all.end(), mine.begin(), mine.end());
  std::ranges::sort(all, {},
                    [&](const GapSpan& s) { return std::tuple(s.axis, s.first[2], s.first[1], s.first[0]); });
  return all;
}

/// Whether a span lies in a gap and not in a crevice: most columns around it are in the gap too.
bool is_wide(const GapSpan& span, const VoxelBits& gap) {
  const std::size_t u = span.axis == 0 ? 1 : 0, v = span.axis == 2 ? 1 : 2;
  int filled = 0;
  for (int p = -kGapLateral; p <= kGapLateral; ++p)
    for (int q = -kGapLateral; q <= kGapLateral; ++q) {
      std::array<int, 3> at = span.middle();
      at[u] += p;
      at[v] += q;
      bool is_filled = false;
      for (const int off : {0, -1, 1}) {
        std::array<int, 3> near = at;
        near[span.axis] += off;
        bool inside = true;
        for (std::size_t a = 0; a < 3; ++a) inside = inside && near[a] >= 0 && near[a] < gap.dims()[a];
        is_filled = is_filled || (inside && gap.at(near[0], near[1], near[2]));
      }
      filled += is_filled;
    }
  constexpr int kColumns = (2 * kGapLateral + 1) * (2 * kGapLateral + 1);
  return filled >= kGapFilled * kColumns;
}

/// Voxels of the components (by faces) of a set that reach the outermost layer of the grid.
VoxelBits connected_with_border(const VoxelBits& set) {
  RunVolume runs = set.runs();
  const std::vector<Component> components = connect(runs);
  VoxelBits out(set.dims());
  for (int k = 0; k < set.dims()[2]; ++k)
    for (int j = 0; j < set.dims()[1]; ++j)
      for (const VoxelRun& run : runs.row(j, k))
        if (components[run.node].at_border) out.set_run(run.first, run.last, j, k);
  return out;
}

/// Structures that a ball with the radius of the tool can touch when it comes from outside the volume, by
/// id.
/// @param hard  by id: structures that the ball cannot pass through
Result<std::vector<bool>> reached(const LintContext& context, const RunVolume& runs,
                                  const std::vector<bool>& hard, const ProgressSpan& span) {
  const double radius_mm = context.options.tool_radius_mm, widest_mm = context.grid.spacing_mm.maxCoeff();
  const auto& dims = context.grid.dims;
  VoxelBits obstacles(dims);
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (const VoxelRun& run : runs.row(j, k))
        if (run.value != 0 && hard[run.value]) obstacles.set_run(run.first, run.last, j, k);
  // An obstacle's surface lies half a voxel outside the centres of its voxels, and the tool's centre up to
  // half a voxel away from the centre of a voxel. On average over passages of odd and even width the two
  // amount to a quarter of a voxel.
  const double blocked_mm = radius_mm + 0.25 * context.grid.min_spacing_mm();
  auto blocked = obstacles.dilated(blocked_mm, context.grid.spacing_mm, context.workers, context.progress,
                                   span.part(0, 0.4));
  if (!blocked) return blocked.error();
  blocked->invert();
  const auto touched = connected_with_border(*blocked).dilated(
      blocked_mm + widest_mm, context.grid.spacing_mm, context.workers, context.progress, span.part(0.5, 1));
  if (!touched) return touched.error();
  std::vector<bool> out(hard.size());
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (const VoxelRun& run : runs.row(j, k)) {
        if (run.value == 0 || out[run.value]) continue;
        const bool at_border = k == 0 || k == dims[2] - 1 || j == 0 || j == dims[1] - 1 || run.first == 0 ||
                               run.last == dims[0] - 1;
        out[run.value] = at_border || touched->any(run.first, run.last, j, k);
      }
  return out;
}

struct AirThreshold {
  double below = -std::numeric_limits<double>::infinity();  ///< Scan values below this are air
  bool is_hounsfield = false;                               ///< Whether the scan is a CT; in other scans
                                                            ///< bone may be as dark as air
};

AirThreshold air_limit(const Volume<float>& scan) {
  constexpr std::size_t kMaxSampled = 500'000;
  std::vector<float> values;
  const std::size_t step = std::max<std::size_t>(1, scan.voxels().size() / kMaxSampled);
  for (std::size_t n = 0; n < scan.voxels().size(); n += step)
    if (std::isfinite(scan.voxels()[n])) values.push_back(scan.voxels()[n]);
  if (values.empty()) return {};
  const auto percentile = [&](double p) {
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(p * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return static_cast<double>(*at);
  };
  const double low = percentile(0.01), high = percentile(0.99);
  constexpr double kHounsfield = -500, kAir_HU = -400, kAirFraction = 0.1;
  if (low < kHounsfield) return {kAir_HU, true};
  return {low + kAirFraction * (high - low), false};
}

}  // namespace

Result<void> check_gaps(LintContext& context, const Volume<LabelId>& flat, const ProgressSpan& span) {
  const auto spans = find_spans(context, flat, span);
  if (!spans) return spans.error();
  std::array<VoxelBits, 3> gaps{VoxelBits(context.grid.dims), VoxelBits(context.grid.dims),
                                VoxelBits(context.grid.dims)};
  for (const GapSpan& one : *spans)
    for (int n = 0; n < one.length; ++n) {
      std::array<int, 3> at = one.first;
      at[one.axis] += n;
      gaps[one.axis].set(at[0], at[1], at[2]);
    }
  struct Sum {
    std::array<double, 3> mm2{};
    std::size_t voxels = 0;
    double narrowest_mm = std::numeric_limits<double>::infinity();
    std::vector<std::array<int, 3>> middles;
  };
  std::map<std::pair<LabelId, LabelId>, Sum> sums;
  for (const GapSpan& one : *spans) {
    if (!is_wide(one, gaps[one.axis])) continue;
    Sum& sum = sums[std::minmax(one.a, one.b)];
    sum.mm2[one.axis] += context.face_mm2(one.axis);
    sum.voxels += static_cast<std::size_t>(one.length);
    sum.narrowest_mm =
        std::min(sum.narrowest_mm, one.length * context.grid.spacing_mm[static_cast<Eigen::Index>(one.axis)]);
    sum.middles.push_back(one.middle());
  }
  for (const auto& [pair, sum] : sums) {
    const double mm2 = std::hypot(sum.mm2[0], sum.mm2[1], sum.mm2[2]);
    if (mm2 < kGap_mm2) continue;
    const std::array<int, 3>& middle = sum.middles[sum.middles.size() / 2];
    std::vector<LabelId> ids{pair.first};
    if (pair.second != pair.first) ids.push_back(pair.second);
    context.add(
        LintKind::kNarrowGap, LintSeverity::kWarning, ids, {sum.narrowest_mm, "mm", sum.voxels, middle},
        (ids.size() == 1 ? "a gap within " + context.name_of(pair.first)
                         : "the gap between " + context.names_of(ids)) +
            " is narrower than the tool (" + figure(2 * context.options.tool_radius_mm, "mm") + ") over " +
            figure(mm2, "mm2") + ", " + figure(sum.narrowest_mm, "mm") + " at its narrowest");
  }
  return {};
}

Result<void> check_access(LintContext& context, const Volume<LabelId>& flat, const ProgressSpan& span) {
  std::size_t largest = 0;
  for (const SegmentStatistics& s : context.statistics) largest = std::max<std::size_t>(largest, s.id);
  std::vector<bool> hard(largest + 1), perhaps_hard(largest + 1);
  for (const SegmentStatistics& s : context.statistics) {
    const Segment* segment = context.labels.find(s.id);
    const auto known = context.options.is_hard && !segment->name.empty()
                           ? context.options.is_hard(segment->name)
                           : std::nullopt;
    hard[s.id] = known == true;
    perhaps_hard[s.id] = known != false;
  }
  const bool any_hard = std::ranges::find(hard, true) != hard.end();
  const bool any_unknown = hard != perhaps_hard;
  if (!any_hard && !any_unknown) return {};
  const auto runs = runs_of(flat, context.workers, context.progress, span.part(0, 0.1));
  if (!runs) return runs.error();
  const std::vector<bool> all(largest + 1, true);
  auto surely = any_hard ? reached(context, *runs, hard, span.part(0.1, 0.55)) : Result(all);
  if (!surely) return surely.error();
  auto perhaps = any_unknown ? reached(context, *runs, perhaps_hard, span.part(0.55, 1)) : surely;
  if (!perhaps) return perhaps.error();
  std::vector<LabelId> undecided;
  for (const SegmentStatistics& s : context.statistics) {
    const std::array<int, 3> voxel{(s.box_min[0] + s.box_max[0]) / 2, (s.box_min[1] + s.box_max[1]) / 2,
                                   (s.box_min[2] + s.box_max[2]) / 2};
    if (!(*surely)[s.id])
      context.add(LintKind::kUnreachable, LintSeverity::kWarning, {s.id},
                  {s.volume_mm3, "mm3", s.voxels, voxel},
                  "a tool of " + figure(2 * context.options.tool_radius_mm, "mm") + " cannot reach " +
                      context.name_of(s.id) + " past the hard structures around it");
    else if (!(*perhaps)[s.id])
      undecided.push_back(s.id);
  }
  if (!undecided.empty())
    context.add(LintKind::kUnreachable, LintSeverity::kUndetermined, undecided, {},
                context.names_of(undecided) + (undecided.size() == 1 ? " is" : " are") +
                    " enclosed by structures whose names do not tell whether a tool can pass through them");
  return {};
}

Result<void> check_body(LintContext& context, const Volume<LabelId>& flat, const ProgressSpan& span) {
  if (context.statistics.empty()) return {};
  if (context.options.scan == nullptr) {
    context.add(LintKind::kOutsideBody, LintSeverity::kUndetermined, {}, {},
                "without a scan the outside of the body is unknown");
    return {};
  }
  const auto& dims = context.grid.dims;
  std::optional<Volume<float>> moved;
  if (!context.options.scan->geometry().same_grid(context.grid)) {
    auto resampled =
        resample_linear(*context.options.scan, context.grid, std::numeric_limits<float>::quiet_NaN());
    if (!resampled) return resampled.error();
    moved = *std::move(resampled);
  }
  const Volume<float>& scan = moved ? *moved : *context.options.scan;
  const AirThreshold air_is = air_limit(scan);
  const auto limit = static_cast<float>(air_is.below);
  VoxelBits tissue(dims);
  struct Sum {
    std::size_t outside_scan = 0, in_air = 0;
    std::array<int, 3> outside_voxel{}, air_voxel{};
  };
  std::map<LabelId, Sum> sums;
  for (int k = 0; k < dims[2]; ++k) {
    if (context.progress.stopped()) return Progress::interrupted();
    for (int j = 0; j < dims[1]; ++j) {
      const std::size_t first = context.grid.offset(0, j, k);
      for (int i = 0; i < dims[0]; ++i) {
        const float value = scan.voxels()[first + static_cast<std::size_t>(i)];
        // values that are not finite lie outside the scan and do not count as air
        if (!(value < limit)) tissue.set(i, j, k);
        if (std::isfinite(value)) continue;
        const LabelId label = flat.voxels()[first + static_cast<std::size_t>(i)];
        if (label == 0) continue;
        Sum& sum = sums[label];
        if (sum.outside_scan++ == 0) sum.outside_voxel = {i, j, k};
      }
    }
  }
  auto air = tissue.dilated(1.01 * context.grid.spacing_mm.maxCoeff(), context.grid.spacing_mm,
                            context.workers, context.progress, span);
  if (!air) return air.error();
  air->invert();
  RunVolume runs = air->runs();
  const std::vector<Component> components = connect(runs);
  // the air around the body reaches an edge of the volume; the air of an airway cut by a face does not
  std::vector<bool> is_outer(components.size());
  const auto ends = [&](int at, int axis) {
    return at == 0 || at == dims[static_cast<std::size_t>(axis)] - 1;
  };
  const auto for_each_air_run = [&](const auto& visit) {
    for (int k = 0; k < dims[2]; ++k)
      for (int j = 0; j < dims[1]; ++j)
        for (const VoxelRun& run : runs.row(j, k)) visit(run, j, k);
  };
  for_each_air_run([&](const VoxelRun& run, int j, int k) {
    const bool along_i = run.first == 0 || run.last == dims[0] - 1;
    if (int{ends(j, 1)} + int{ends(k, 2)} + int{along_i} >= 2) is_outer[run.node] = true;
  });
  for_each_air_run([&](const VoxelRun& run, int j, int k) {
    if (!is_outer[run.node]) return;
    const std::size_t first = context.grid.offset(0, j, k);
    for (int i = run.first; i <= run.last; ++i) {
      const LabelId label = flat.voxels()[first + static_cast<std::size_t>(i)];
      if (label == 0) continue;
      Sum& sum = sums[label];
      if (sum.in_air++ == 0) sum.air_voxel = {i, j, k};
    }
  });
  constexpr double kAirFraction = 0.02, kOutsideFraction = 0.05;
  constexpr std::size_t kAir_voxels = 10;
  for (const auto& [id, sum] : sums) {
    const auto all = static_cast<double>(context.statistics_of(id)->voxels);
    const double air_fraction = static_cast<double>(sum.in_air) / all,
                 outside_fraction = static_cast<double>(sum.outside_scan) / all;
    if (sum.in_air >= kAir_voxels && air_fraction >= kAirFraction)
      context.add(LintKind::kOutsideBody,
                  air_is.is_hounsfield ? LintSeverity::kFault : LintSeverity::kWarning, {id},
                  {100 * air_fraction, "%", sum.in_air, sum.air_voxel},
                  figure(100 * air_fraction, "%") + " of " + context.name_of(id) +
                      " lies in the air around the body");
    if (outside_fraction >= kOutsideFraction)
      context.add(
          LintKind::kOutsideScan, LintSeverity::kFault, {id},
          {100 * outside_fraction, "%", sum.outside_scan, sum.outside_voxel},
          figure(100 * outside_fraction, "%") + " of " + context.name_of(id) + " lies outside the scan");
  }
  return {};
}

}  // namespace palpate::internal
