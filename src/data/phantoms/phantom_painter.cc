#include <algorithm>
#include <cmath>
#include <new>
#include <optional>

#include "palpate/base/for_each_index.h"
#include "palpate/base/hash.h"
#include "phantoms/phantom_plan.h"
#include "phantoms/phantom_scan.h"
#include "phantoms/segmentation_noise.h"
#include "phantoms/shape_blocks.h"

namespace palpate {
namespace {

// Part that may affect a block; without a node it covers the whole block uniformly.
struct Candidate {
  std::size_t part;
  Shape::Node::Ptr node;
};
using Candidates = std::vector<Candidate>;

// width over which a surface is blended: the voxel's edge, or the mean of its shortest and longest edge
double mixing_width_mm(const GridGeometry& grid) {
  return 0.5 * (grid.spacing_mm.minCoeff() + grid.spacing_mm.maxCoeff());
}

// Paints the parts in order, block by block. Shapes are evaluated in the anatomy's millimetres; a distance
// there times the smallest scale is a lower bound of the distance in patient millimetres.
class Painter {
 public:
  Painter(const PhantomPlan& plan, const std::optional<BorderJitter>& jitter, Volume<LabelId>& labels,
          Volume<float>& scan)
      : parts_(plan.parts),
        imaging_(plan.imaging),
        jitter_(jitter),
        labels_(labels),
        scan_(scan),
        voxel_mm_(mixing_width_mm(scan.geometry())),
        scale_(plan.field.scale),
        min_scale_(plan.field.scale.minCoeff()),
        X_PatientVoxel_(scan.geometry().X_PatientVoxel()) {}

  Candidates everything() const {
    Candidates all;
    for (std::size_t i = 0; i < parts_.size(); ++i) all.push_back({i, parts_[i].shape.node()});
    return all;
  }

  // blocks are never finished before the leaves, because the shading varies from voxel to voxel
  std::optional<Candidates> narrow(const Candidates& candidates, const Ball& ball) const {
    const double radius = ball.radius + (jitter_ ? jitter_->max_mm() : 0);
    const Ball anatomical{ball.centre.cwiseQuotient(scale_), radius / min_scale_};
    Candidates here;
    for (const Candidate& candidate : candidates) {
      if (candidate.node == nullptr) {
        here.push_back(candidate);
        continue;
      }
      const Shape::Node::Within within = candidate.node->within(candidate.node, anatomical);
      const double distance = within.distance * min_scale_;
      const double reach = radius + 0.5 * voxel_mm_;
      if (distance > reach) continue;
      const bool even = distance + material_depth_mm(parts_[candidate.part].material) < -reach;
      // below an invisible part the scan shows the surrounding material
      if (even && parts_[candidate.part].material != PhantomMaterial::kInvisible) here.clear();
      here.push_back({candidate.part, even ? nullptr : within.node});
    }
    return here;
  }

  void paint_block(const Candidates& candidates, const VoxelBlock& block) const {
    block.for_each_voxel([&](int i, int j, int k) {
      const Eigen::Vector3d p = (X_PatientVoxel_ * Point<Voxel>(i, j, k)).eigen();
      const Eigen::Vector3d anatomical = p.cwiseQuotient(scale_);
      double signal = background(imaging_);
      LabelId label = 0;
      for (const Candidate& candidate : candidates) {
        const PhantomPart& part = parts_[candidate.part];
        const double d = distance_mm(candidate, anatomical);
        signal = paint(part.material, imaging_, signal, d, voxel_mm_);
        if (d < 0 && part.label != 0) label = part.label;
      }
      labels_.at(i, j, k) = jitter_ ? drawn_label(candidates, p, {i, j, k}) : label;
      scan_.at(i, j, k) = static_cast<float>(signal * shading(imaging_, anatomical));
    });
  }

 private:
  double distance_mm(const Candidate& candidate, const Eigen::Vector3d& anatomical) const {
    return candidate.node == nullptr ? -1e3 : candidate.node->distance(anatomical) * min_scale_;
  }

  // label at the position where the simulated operator drew the voxel
  LabelId drawn_label(const Candidates& candidates, const Eigen::Vector3d& p,
                      const std::array<int, 3>& voxel) const {
    const Eigen::Vector3d from_origin = p - labels_.geometry().origin.eigen();
    const int slice = voxel[static_cast<std::size_t>(jitter_->axis())];
    const Eigen::Vector3d anatomical =
        (p + jitter_->displacement_mm(from_origin, slice)).cwiseQuotient(scale_);
    LabelId label = 0;
    for (const Candidate& candidate : candidates) {
      const PhantomPart& part = parts_[candidate.part];
      if (part.label != 0 && distance_mm(candidate, anatomical) < 0) label = part.label;
    }
    return label;
  }

  const std::vector<PhantomPart>& parts_;
  PhantomImaging imaging_;
  const std::optional<BorderJitter>& jitter_;
  Volume<LabelId>& labels_;
  Volume<float>& scan_;
  double voxel_mm_;
  Eigen::Vector3d scale_;
  double min_scale_;
  Transform<Patient, Voxel> X_PatientVoxel_;
};

// Removes components of a few voxels: where surfaces meet at an acute edge, sampling can leave single voxels
// connected to their structure only at a corner, which a segmentation by hand does not contain.
void drop_specks(Volume<LabelId>& labels) {
  constexpr std::size_t kSpeckVoxels = 10;
  const GridGeometry& grid = labels.geometry();
  std::vector<bool> visited(grid.voxel_count(), false);
  std::vector<std::array<int, 3>> open;
  std::vector<std::size_t> piece;  // first voxels of the component
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const LabelId label = labels.at(i, j, k);
        piece.clear();
        const auto enter = [&](int x, int y, int z) {
          if (labels.at_or(x, y, z, 0) != label || visited[grid.offset(x, y, z)]) return;
          visited[grid.offset(x, y, z)] = true;
          open.push_back({x, y, z});
          if (piece.size() <= kSpeckVoxels) piece.push_back(grid.offset(x, y, z));
        };
        if (label != 0) enter(i, j, k);
        while (!open.empty()) {
          const auto [x, y, z] = open.back();
          open.pop_back();
          for (const int step : {-1, 1}) {
            enter(x + step, y, z);
            enter(x, y + step, z);
            enter(x, y, z + step);
          }
        }
        if (piece.size() > kSpeckVoxels) continue;
        for (const std::size_t voxel : piece) labels.voxels()[voxel] = 0;
      }
    }
  }
}

bool add_scan_noise(Volume<float>& scan, PhantomImaging imaging, std::uint64_t seed,
                    const Progress& progress) {
  const auto& dims = scan.geometry().dims;
  const std::size_t slice = static_cast<std::size_t>(dims[0]) * static_cast<std::size_t>(dims[1]);
  return for_each_index(dims[2], worker_count(0, dims[2]), [&](int, int k) {
    if (progress.stopped()) return false;
    add_noise(imaging, &scan.at(0, 0, k), slice, seed, k);
    return true;
  });
}

template <class T>
void mirror_x(Volume<T>& volume) {
  const auto& dims = volume.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j) std::reverse(&volume.at(0, j, k), &volume.at(0, j, k) + dims[0]);
}

// combines both seeds; the mean shape uses scan_seed alone, so that its scan never changes
std::uint64_t seed_of_scan(const PhantomSettings& settings) {
  if (settings.seed == 0) return settings.scan_seed;
  std::uint64_t state = kHashSeed;
  hash_word(state, settings.seed);
  hash_word(state, settings.scan_seed);
  return hash_finish(state);
}

}  // namespace

GridGeometry PhantomField::grid(const Eigen::Vector3d& spacing_mm) const {
  GridGeometry grid;
  const Eigen::Vector3d extent = extent_mm.cwiseProduct(scale), middle = middle_mm.cwiseProduct(scale);
  for (int a = 0; a < 3; ++a)
    grid.dims[static_cast<std::size_t>(a)] = static_cast<int>(std::lround(extent[a] / spacing_mm[a]));
  grid.spacing_mm = spacing_mm;
  const Eigen::Vector3d last(grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1);
  grid.origin = Point<Patient>(middle - 0.5 * spacing_mm.cwiseProduct(last));
  return grid;
}

std::vector<Segment> segments_of(const PhantomPlan& plan) {
  std::vector<Segment> segments;
  for (const PhantomPart& part : plan.parts)
    if (part.label != 0) segments.push_back({part.label, part.name, part.colour, 0, part.label});
  std::ranges::sort(segments, {}, &Segment::id);
  return segments;
}

Result<Phantom> paint_phantom(const PhantomPlan& plan, const PhantomSettings& settings,
                              const Progress& progress) try {
  const GridGeometry grid = plan.field.grid(settings.spacing_mm);
  Volume<LabelId> labels(grid);
  Volume<float> scan(grid);
  std::optional<BorderJitter> jitter;
  if (settings.noise_mm > 0) jitter.emplace(grid, settings.noise_mm, settings.seed);

  const Painter painter(plan, jitter, labels, scan);
  const auto narrow = [&](const Candidates& c, const VoxelBlock&, const Ball& ball) {
    return painter.narrow(c, ball);
  };
  const auto leaf = [&](const Candidates& c, const VoxelBlock& block) { painter.paint_block(c, block); };
  if (!visit_grid(grid, painter.everything(), "phantom", progress, narrow, leaf))
    return Progress::interrupted();
  drop_specks(labels);
  add_islands_and_holes(labels, settings.islands, settings.seed);
  if (!add_scan_noise(scan, plan.imaging, seed_of_scan(settings), progress)) return Progress::interrupted();
  if (plan.mirrored) {
    mirror_x(labels);
    mirror_x(scan);
  }

  Phantom phantom;
  phantom.labels.layers.push_back(std::move(labels));
  phantom.scan = std::move(scan);
  phantom.labels.segments = segments_of(plan);
  return phantom;
} catch (const std::bad_alloc&) {
  return Error{ErrorKind::kBadInput, "not enough memory for a phantom of this voxel size", "",
               "use larger voxels"};
}

}  // namespace palpate
