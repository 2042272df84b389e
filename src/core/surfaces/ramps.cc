#include "palpate/surfaces/ramps.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <sstream>

#include "surfaces/raised_field.h"
#include "surfaces/ramps_depth.h"
#include "surfaces/surface_components.h"
#include "surfaces/touching.h"

namespace palpate {

namespace {

using internal::DepthOptions;
using internal::Index3;
using internal::ProgressSpan;
using internal::Span3;
using internal::Touching;

/// Half thickness beyond which the parameters do not change, mm.
constexpr double kThick_mm = 7;

/// Width of the filter of a structure's distance: half of the half thickness, so that the ridge of thin
/// structures keeps three quarters of its height; above 1.5 mm only for structures as thick as bone, which
/// get smoother.
double sigma_mm_of(double half_thickness_mm) {
  return std::max(std::min(0.5 * half_thickness_mm, 1.5), std::min(0.3 * half_thickness_mm, 2.0));
}

constexpr float kFullScale = 65535;

Error bad_input(const std::string& what, const std::string& remedy) {
  return {ErrorKind::kBadInput, what, "", remedy};
}

template <class Value>
std::string text_of(const char* before, Value value, const char* after) {
  std::ostringstream text;
  text << before << value << after;
  return text.str();
}

Result<void> check(const std::vector<RampStructure>& structures, const RampOptions& options) {
  if (!(options.width_mm >= kMinRampWidth_mm && options.width_mm <= kMaxRampWidth_mm))
    return bad_input(text_of("the width of a ramp is ", options.width_mm, " mm"), "give 1 to 12 mm");
  if (!(options.stiffest_N_per_mm >= 0 && std::isfinite(options.stiffest_N_per_mm)))
    return bad_input(text_of("the maximum stiffness is ", options.stiffest_N_per_mm, " N/mm"),
                     "give 0 for that of the structures, or at least that value");
  if (options.threads < 0)
    return bad_input(text_of("the number of threads is ", options.threads, ""),
                     "give 0 for all processors, or at least 1");
  for (const RampStructure& s : structures) {
    if (s.label == 0) return bad_input("label 0 is the background", "choose among the labels");
    if (!(s.stiffness_N_per_mm > 0 && std::isfinite(s.stiffness_N_per_mm)))
      return bad_input(text_of("a stiffness is ", s.stiffness_N_per_mm, " N/mm"), "give more than 0");
    for (const LabelId support : s.rests_on) {
      const auto found = std::find_if(structures.begin(), structures.end(),
                                      [&](const RampStructure& other) { return other.label == support; });
      if (found == structures.end())
        return bad_input(text_of("label ", s.label, " rests on one that is not touchable"),
                         "set it touchable too");
      if (std::find(found->rests_on.begin(), found->rests_on.end(), s.label) != found->rests_on.end())
        return bad_input(text_of("label ", s.label, " and its support rest on each other"),
                         "remove one of the two rests_on");
      if (found->stiffness_N_per_mm < s.stiffness_N_per_mm)
        return bad_input(text_of("label ", s.label, " is stiffer than one that it rests on"),
                         "make it no stiffer");
    }
  }
  return {};
}

/// Index of the structure of each label, -1 for none.
std::vector<int> index_by_label(const std::vector<RampStructure>& structures) {
  std::vector<int> index(kLabelValues, -1);
  for (std::size_t s = 0; s < structures.size(); ++s) index[structures[s].label] = static_cast<int>(s);
  return index;
}

/// Depth-first traversal of the chains of structures resting on each other, starting at every structure; each
/// chain raises the field at its voxels.
class ChainTraversal {
 public:
  ChainTraversal(const Bricks<LabelId>& labels, const std::vector<RampStructure>& structures,
                 const std::vector<Span3>& spans, const Touching& touching, const RampOptions& options,
                 const Progress& progress, double full_force_N, internal::RaisedField& field)
      : labels_(labels),
        structures_(structures),
        spans_(spans),
        touching_(touching),
        options_(options),
        progress_(progress),
        full_force_N_(full_force_N),
        field_(field) {}

  Result<void> from(std::size_t root, const ProgressSpan& stage) {
    auto half_mm =
        internal::median_half_thickness_mm(labels_, structures_[root].label, span_of(root), kThick_mm,
                                           options_.threads, progress_, stage.part(0, 0.1));
    if (!half_mm) return half_mm.error();
    half_thickness_mm = *half_mm;
    sigma_mm_ = sigma_mm_of(half_thickness_mm);
    return climb(root, stage.part(0.1, 1));
  }

  double half_thickness_mm = 0;  ///< Half thickness of the last root structure

 private:
  // a structure of the chain, and the depth below the union of it with all links before
  struct Link {
    std::size_t structure;
    int deepest;  ///< In steps
    Span3 box;
    Bricks<std::int16_t> position;  ///< Over the box
  };

  const Span3& span_of(std::size_t structure) const { return spans_[structures_[structure].label]; }
  double stiffness(std::size_t structure) const { return structures_[structure].stiffness_N_per_mm; }

  bool rests_on_top(std::size_t structure) const {
    const std::size_t top = chain_.back().structure;
    const auto& supports = structures_[structure].rests_on;
    return touching_(structure, top) &&
           std::find(supports.begin(), supports.end(), structures_[top].label) != supports.end();
  }

  // the new top only changes the depth near it
  Span3 box_of(std::size_t structure, const DepthOptions& depth) const {
    if (chain_.empty()) return span_of(structure);
    const Span3 near =
        span_of(structure).grown(internal::position_window(labels_.geometry().spacing_mm, depth));
    Span3 hull = span_of(structure);
    for (const Link& link : chain_)
      for (int a = 0; a < 3; ++a) {
        hull.low[a] = std::min(hull.low[a], span_of(link.structure).low[a]);
        hull.high[a] = std::max(hull.high[a], span_of(link.structure).high[a]);
      }
    return near.clipped(hull);
  }

  Result<void> climb(std::size_t structure, const ProgressSpan& stage) {
    if (++chains_ > kMaxRampChains)
      return bad_input(text_of("more than ", kMaxRampChains, " chains of structures that rest on each other"),
                       "use fewer rests_on, or prepare with method = \"union-gaussian\"");
    const DepthOptions depth{std::min(full_force_N_ / stiffness(structure), kDeepestRamp_mm), sigma_mm_,
                             options_.threads};
    const Span3 box = box_of(structure, depth);
    std::vector<LabelId> set{structures_[structure].label};
    for (const Link& link : chain_) set.push_back(structures_[link.structure].label);
    auto position = internal::set_position(labels_, set, depth, progress_, stage.part(0, 0.4), box);
    if (!position) return position.error();
    chain_.push_back(
        {structure, static_cast<int>(depth.reach_mm / kSurfaceStep_mm), box, *std::move(position)});
    auto done = raise_field(stage.part(0.4, 0.5));
    std::vector<std::size_t> onward;
    for (std::size_t next = 0; next < structures_.size(); ++next)
      if (rests_on_top(next)) onward.push_back(next);
    for (std::size_t n = 0; n < onward.size() && done; ++n) {
      const auto from = static_cast<double>(n), count = static_cast<double>(onward.size());
      done = climb(onward[n], stage.part(0.5 + 0.5 * from / count, 0.5 + 0.5 * (from + 1) / count));
    }
    chain_.pop_back();
    return done;
  }

  // raises the field to at least the chain's value
  Result<void> raise_field(const ProgressSpan& stage) {
    const Span3 span = chain_.back().box;
    const int workers = worker_count(options_.threads, span.size(2));
    const auto length = static_cast<std::size_t>(span.size(0));
    std::vector<float> per_step;
    for (std::size_t m = 0; m < chain_.size(); ++m) {
      const double above = m + 1 < chain_.size() ? stiffness(chain_[m + 1].structure) : 0;
      per_step.push_back(static_cast<float>((stiffness(chain_[m].structure) - above) * kSurfaceStep_mm *
                                            kFullScale / full_force_N_));
    }
    struct Scratch {
      std::vector<float> depth, sum;
      std::vector<std::int16_t> position;
      std::vector<std::uint16_t> raised;  // one slice
    };
    std::vector<Scratch> of_worker(
        static_cast<std::size_t>(workers),
        {std::vector<float>(length), std::vector<float>(length), std::vector<std::int16_t>(length),
         std::vector<std::uint16_t>(length * static_cast<std::size_t>(span.size(1)))});
    const auto slice = [&](int worker, int n) {
      Scratch& scratch = of_worker[static_cast<std::size_t>(worker)];
      std::vector<float>&d = scratch.depth, &v = scratch.sum;
      const int k = span.low[2] + n;
      for (int j = span.low[1]; j < span.high[1]; ++j) {
        std::fill(d.begin(), d.end(), 0.0f);
        std::fill(v.begin(), v.end(), 0.0f);
        for (std::size_t m = 0; m < chain_.size(); ++m) {
          // outside a link's box the depth is that of the preceding links
          const Span3& box = chain_[m].box;
          const Span3 row = Span3{{span.low[0], j, k}, {span.high[0], j + 1, k + 1}}.clipped(box);
          if (!row.empty()) {
            std::int16_t* const from = scratch.position.data();
            chain_[m].position.copy_row(row.low[0] - box.low[0], j - box.low[1], k - box.low[2], row.size(0),
                                        from);
            float* to = d.data() + (row.low[0] - span.low[0]);
            const int deepest = chain_[m].deepest;
            for (int i = 0; i < row.size(0); ++i)
              to[i] = static_cast<float>(std::clamp(-from[i], 0, deepest));
          }
          for (std::size_t i = 0; i < length; ++i) v[i] += per_step[m] * d[i];
        }
        std::uint16_t* out = scratch.raised.data() + length * static_cast<std::size_t>(j - span.low[1]);
        for (std::size_t i = 0; i < length; ++i) {
          const float inside = d[i] > 0 ? 1.0f : 0.0f;
          const float value = std::clamp(v[i] + 0.5f, inside, kFullScale);
          out[i] = static_cast<std::uint16_t>(static_cast<int>(value) * (d[i] > 0 ? 1 : 0));
        }
      }
      field_.raise(k, span, scratch.raised.data());
    };
    return internal::for_each_slice(span.size(2), workers, progress_, stage, slice);
  }

  const Bricks<LabelId>& labels_;
  const std::vector<RampStructure>& structures_;
  const std::vector<Span3>& spans_;
  const Touching& touching_;
  const RampOptions& options_;
  const Progress& progress_;
  double full_force_N_;
  internal::RaisedField& field_;
  double sigma_mm_ = 0;
  int chains_ = 0;
  std::vector<Link> chain_;
};

/// Greatest field value of every structure.
Result<std::vector<std::uint16_t>> max_values(const Bricks<LabelId>& labels, const std::vector<int>& index,
                                              std::size_t structures, const Bricks<std::uint16_t>& field,
                                              int threads, const Progress& progress,
                                              const ProgressSpan& stage) {
  const GridGeometry& grid = labels.geometry();
  const int workers = worker_count(threads, grid.dims[2]);
  // one more entry for voxels of no structure
  std::vector<std::vector<std::uint16_t>> greatest(static_cast<std::size_t>(workers),
                                                   std::vector<std::uint16_t>(structures + 1, 0));
  const auto done = internal::for_each_slice(grid.dims[2], workers, progress, stage, [&](int worker, int k) {
    std::vector<std::uint16_t>& mine = greatest[static_cast<std::size_t>(worker)];
    const auto visit_piece = [&](const RowPiece<LabelId>& piece) {
      // same grid, hence the same pieces
      const std::uint16_t* const value = field.view().cell(piece.i, piece.j, k);
      for (int i = 0; i < piece.count; ++i) {
        if (value[i] == 0) continue;
        std::uint16_t& most = mine[static_cast<std::size_t>(index[piece.voxels[i]])];
        most = std::max(most, value[i]);
      }
    };
    for (int j = 0; j < grid.dims[1]; ++j) labels.for_each_piece(j, k, visit_piece);
  });
  if (!done) return done.error();
  for (std::size_t w = 1; w < greatest.size(); ++w)
    for (std::size_t s = 0; s < structures; ++s) greatest[0][s] = std::max(greatest[0][s], greatest[w][s]);
  return greatest[0];
}

Result<Ramps> prepare(const Bricks<LabelId>& labels, const std::vector<RampStructure>& structures,
                      const RampOptions& options, const Progress& progress) {
  Ramps ramps;
  ramps.full_force_N = options.stiffest_N_per_mm * options.width_mm;
  for (const RampStructure& s : structures)
    ramps.full_force_N = std::max(ramps.full_force_N, s.stiffness_N_per_mm * options.width_mm);

  const ProgressSpan work{"preparing ramps"};
  const std::vector<int> index = index_by_label(structures);
  const auto touching = internal::find_touching(labels, index, structures.size(), internal::Adjacency::kFace,
                                                options.threads, progress, work.part(0, 0.05));
  if (!touching) return touching.error();
  const std::vector<Span3> spans = internal::label_spans(labels);
  internal::RaisedField field(labels.geometry());
  ChainTraversal traversal(labels, structures, spans, *touching, options, progress, ramps.full_force_N,
                           field);
  const auto count = static_cast<double>(structures.size());
  for (std::size_t s = 0; s < structures.size(); ++s) {
    if (spans[structures[s].label].empty()) continue;
    const auto n = static_cast<double>(s);
    const auto done = traversal.from(s, work.part(0.05 + 0.9 * n / count, 0.05 + 0.9 * (n + 1) / count));
    if (!done) return done.error();
    ramps.structures.push_back({structures[s].label, 0, traversal.half_thickness_mm});
  }
  ramps.field = field.take();
  const auto greatest = max_values(labels, index, structures.size(), ramps.field, options.threads, progress,
                                   work.part(0.95, 1));
  if (!greatest) return greatest.error();
  for (RampStatistics& figures : ramps.structures)
    figures.max_N =
        ramps.full_force_N * (*greatest)[static_cast<std::size_t>(index[figures.label])] / kFullScale;
  return ramps;
}

}  // namespace

Result<Ramps> prepare_ramps(const Bricks<LabelId>& labels, const std::vector<RampStructure>& structures,
                            const RampOptions& options, const Progress& progress) {
  const auto checked = check(structures, options);
  if (!checked) return checked.error();
  try {
    return prepare(labels, structures, options, progress);
  } catch (const std::bad_alloc&) {
    return bad_input("not enough memory to prepare the ramps", "close other programs, or crop the volume");
  }
}

Result<double> ramp_width_mm(std::optional<double> requested_mm, const GridGeometry& grid) {
  const double widest_mm = grid.spacing_mm.maxCoeff();
  // default widths never fail: scenes for the proxy, which does not use ramps, must load on coarse voxels too
  if (!requested_mm) return std::clamp(2 * widest_mm, kUsualRampWidth_mm, kMaxRampWidth_mm);
  const double width_mm = *requested_mm;
  // tolerance for rounding of direction matrices
  if (width_mm >= 2 * widest_mm * (1 - 1e-6) && width_mm <= kMaxRampWidth_mm) return width_mm;
  return bad_input(text_of("the ramp width is ", width_mm, "") +
                       text_of(" mm, and voxels are up to ", widest_mm, " mm wide"),
                   2 * widest_mm <= kMaxRampWidth_mm
                       ? text_of("give a ramp_width of two voxels or more, ", 2 * widest_mm, " mm")
                       : text_of("a ramp is at least two voxels and at most ", kMaxRampWidth_mm,
                                 " mm; give method = \"union-gaussian\""));
}

Bricks<std::uint8_t> in_eight_bits(const Bricks<std::uint16_t>& ramp) {
  std::vector<std::uint8_t> eight(std::size_t{65536});
  for (std::size_t v = 1; v < eight.size(); ++v)
    eight[v] = static_cast<std::uint8_t>(std::max<std::size_t>(1, (v + 128) / 257));
  return Bricks<std::uint8_t>::of_labels(ramp, eight);
}

}  // namespace palpate
