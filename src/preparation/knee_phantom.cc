#include <cmath>
#include <new>

#include "preparation/knee_phantom_anatomy.h"
#include "preparation/knee_phantom_scan.h"
#include "preparation/shape_blocks.h"

namespace palpate {
namespace {

constexpr double kNoise = 14;
constexpr double kAir = 12;
const Eigen::Vector3d kExtent_mm(110, 110, 120);
const Eigen::Vector3d kMiddle_mm(0, -4, 0);

GridGeometry phantom_grid(double voxel_mm) {
  GridGeometry grid;
  for (int a = 0; a < 3; ++a) {
    grid.dims[static_cast<std::size_t>(a)] = static_cast<int>(std::lround(kExtent_mm[a] / voxel_mm));
  }
  grid.spacing_mm = Eigen::Vector3d::Constant(voxel_mm);
  const Eigen::Vector3d last(grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1);
  grid.origin = Point<Patient>(kMiddle_mm - 0.5 * voxel_mm * last);
  return grid;
}

// A part that may change something in a block; without a node it covers the block evenly.
struct Candidate {
  std::size_t part;
  Shape::Node::Ptr node;
};
using Candidates = std::vector<Candidate>;

// Paints the parts one over the other, blockwise.
class Painter {
 public:
  Painter(const std::vector<PhantomPart>& parts, Volume<LabelId>& labels, Volume<float>& scan)
      : parts_(parts),
        labels_(labels),
        scan_(scan),
        voxel_mm_(scan.geometry().spacing_mm[0]),
        X_PatientVoxel_(scan.geometry().X_PatientVoxel()) {}

  Candidates everything() const {
    Candidates all;
    for (std::size_t i = 0; i < parts_.size(); ++i) all.push_back({i, parts_[i].shape.node()});
    return all;
  }

  // never finished before the leaves: every voxel has its own shading
  std::optional<Candidates> narrow(const Candidates& candidates, const Ball& ball) const {
    Candidates here;
    for (const Candidate& candidate : candidates) {
      if (candidate.node == nullptr) {
        here.push_back(candidate);
        continue;
      }
      const Shape::Node::Within within = candidate.node->within(candidate.node, ball);
      const double reach = ball.radius + 0.5 * voxel_mm_;
      if (within.distance > reach) continue;
      const bool even = within.distance + material_depth_mm(parts_[candidate.part].material) < -reach;
      if (even) here.clear();
      here.push_back({candidate.part, even ? nullptr : within.node});
    }
    return here;
  }

  void paint_block(const Candidates& candidates, const Block& block) const {
    block.for_each_voxel([&](int i, int j, int k) {
      const Eigen::Vector3d p = (X_PatientVoxel_ * Point<Voxel>(i, j, k)).eigen();
      double signal = kAir;
      LabelId label = 0;
      for (const Candidate& candidate : candidates) {
        const PhantomPart& part = parts_[candidate.part];
        const double d = candidate.node == nullptr ? -1e3 : candidate.node->distance(p);
        signal = paint(part.material, signal, d, voxel_mm_);
        if (d < 0 && part.label != 0) label = part.label;
      }
      labels_.at(i, j, k) = label;
      scan_.at(i, j, k) = static_cast<float>(signal * coil_sensitivity(p));
    });
  }

 private:
  const std::vector<PhantomPart>& parts_;
  Volume<LabelId>& labels_;
  Volume<float>& scan_;
  double voxel_mm_;
  Transform<Patient, Voxel> X_PatientVoxel_;
};

// Where surfaces meet at an acute edge, sampling can leave single voxels that touch their structure at a
// corner only. A segmentation by hand has none: pieces of a few voxels become background.
void drop_specks(Volume<LabelId>& labels) {
  constexpr std::size_t kSpeckVoxels = 10;
  const GridGeometry& grid = labels.geometry();
  std::vector<bool> seen(grid.voxel_count(), false);
  std::vector<std::array<int, 3>> open;
  std::vector<std::size_t> piece;  // its first voxels
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const LabelId label = labels.at(i, j, k);
        piece.clear();
        const auto enter = [&](int x, int y, int z) {
          if (labels.at_or(x, y, z, 0) != label || seen[grid.offset(x, y, z)]) return;
          seen[grid.offset(x, y, z)] = true;
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

bool add_noise(Volume<float>& scan, std::uint64_t seed, const Progress& progress) {
  const auto& dims = scan.geometry().dims;
  const std::size_t slice = static_cast<std::size_t>(dims[0]) * static_cast<std::size_t>(dims[1]);
  std::atomic<bool> stopped = false;
  tbb::parallel_for(0, dims[2], [&](int k) {
    if (stopped || progress.stopped()) {
      stopped = true;
      return;
    }
    add_rician_noise(&scan.at(0, 0, k), slice, kNoise, seed, k);
  });
  return !stopped;
}

}  // namespace

Result<KneePhantom> make_knee_phantom(double voxel_mm, std::uint64_t seed, const Progress& progress) try {
  if (!(voxel_mm >= 0.2 && voxel_mm <= 3.0)) {
    return Error{ErrorKind::kBadInput, "the knee phantom's voxels must be 0.2 ... 3 mm", "", ""};
  }
  const std::vector<PhantomPart> parts = knee_phantom_parts();
  const GridGeometry grid = phantom_grid(voxel_mm);
  Volume<LabelId> labels(grid);
  Volume<float> scan(grid);

  const Painter painter(parts, labels, scan);
  const auto narrow = [&](const Candidates& c, const Block&, const Ball& ball) {
    return painter.narrow(c, ball);
  };
  const auto leaf = [&](const Candidates& c, const Block& block) { painter.paint_block(c, block); };
  if (!visit_grid(grid, painter.everything(), "knee phantom", progress, narrow, leaf))
    return Progress::interrupted();
  drop_specks(labels);
  if (!add_noise(scan, seed, progress)) return Progress::interrupted();

  KneePhantom phantom;
  phantom.labels.layers.push_back(std::move(labels));
  phantom.scan = std::move(scan);
  for (const PhantomPart& part : parts) {
    if (part.label != 0)
      phantom.labels.segments.push_back({part.label, part.name, part.colour, 0, part.label});
  }
  return phantom;
} catch (const std::bad_alloc&) {
  return Error{ErrorKind::kBadInput, "not enough memory for a phantom of this voxel size", "",
               "use larger voxels"};
}

}  // namespace palpate
