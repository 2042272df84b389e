#include "tissue/relaxation_weights.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

/// Strain energy of cells along a row, times two and per volume, from their nodal displacements: of the
/// strain at the centre and of the hourglass modes (docs/concepts/tissue.md).
class RowEnergy {
 public:
  RowEnergy(const ElasticGrid& grid, const ElasticValues& u, int j, int k)
      : grid_(grid), per_cell_(1 / (4 * grid.box().cell_mm)), cells_(grid.layout().cell(0, j, k)) {
    const ElasticLayout& layout = grid.layout();
    for (int corner = 0; corner < 4; ++corner)
      for (int axis = 0; axis < 3; ++axis)
        row_[corner][axis] = u.data() + layout.node(0, j + (corner & 1), k + (corner >> 1), axis);
  }

  double of(int i) const {
    const double mu = grid_.mu()[cells_ + static_cast<std::size_t>(i)],
                 lambda = grid_.lambda()[cells_ + static_cast<std::size_t>(i)];
    if (!(mu > 0)) return 0;
    double slope[3][3], hourglass = 0;
    for (int axis = 0; axis < 3; ++axis) {
      double sum[4], difference[4];
      for (int corner = 0; corner < 4; ++corner) {
        const double here = row_[corner][axis][i], next = row_[corner][axis][i + 1];
        sum[corner] = here + next;
        difference[corner] = next - here;
      }
      slope[axis][0] = (difference[0] + difference[1] + difference[2] + difference[3]) * per_cell_;
      slope[axis][1] = (sum[1] - sum[0] + sum[3] - sum[2]) * per_cell_;
      slope[axis][2] = (sum[2] - sum[0] + sum[3] - sum[1]) * per_cell_;
      const double xy = difference[1] - difference[0] + difference[3] - difference[2],
                   xz = difference[2] - difference[0] + difference[3] - difference[1],
                   yz = sum[0] - sum[1] - sum[2] + sum[3],
                   xyz = difference[0] - difference[1] - difference[2] + difference[3];
      hourglass += xy * xy + xz * xz + yz * yz + xyz * xyz;
    }
    const double trace = slope[0][0] + slope[1][1] + slope[2][2];
    double squares = 0;
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b) {
        const double e = 0.5 * (slope[a][b] + slope[b][a]);
        squares += e * e;
      }
    // mu h / 64 for each hourglass mode; 1 / (4 h) is per_cell_
    return 2 * mu * squares + lambda * trace * trace + mu * hourglass * per_cell_ * per_cell_ * 0.25;
  }

 private:
  const ElasticGrid& grid_;
  const double per_cell_;
  const std::size_t cells_;
  const float* row_[4][3];
};

// index of the deformable tissue of the voxel at a point; -1: none
int soft_tissue(const Model& model, const Bricks<LabelId>& labels, const Point<Voxel>& at) {
  std::array<int, 3> voxel;
  for (int axis = 0; axis < 3; ++axis)
    voxel[static_cast<std::size_t>(axis)] = static_cast<int>(std::floor(at[axis] + 0.5));
  const LabelId label = labels.anywhere(voxel[0], voxel[1], voxel[2]);
  const Tissue* tissue = model.tissue_of(label);
  if (tissue == nullptr || !tissue->touchable || !model.is_deformable(*tissue)) return -1;
  return model.tissue_of_label[label];
}

}  // namespace

bool RelaxationWeights::is_needed_for(const Model& model) {
  return model.relaxation_times.any() || std::ranges::any_of(model.tissues, [&](const Tissue& tissue) {
           return of(model, tissue).stiffening > 0;
         });
}

RelaxationWeights::TissueKey RelaxationWeights::of(const Model& model, const Tissue& tissue) {
  const bool stiffens = model.tissue_law == TissueLaw::kExponential && tissue.elastic.has_value();
  return {tissue.relaxation, stiffens ? tissue.elastic->stiffening : 0};
}

RelaxationWeights::RelaxationWeights(const Model& model, const CarvedLabels& labels, const ElasticGrid& grid)
    : distinct_means_(1), means_of_cell_(grid.layout().cell_values(), kNone) {
  std::vector<std::uint8_t> kind_of_tissue;
  for (const Tissue& tissue : model.tissues) {
    by_tissue_.push_back(of(model, tissue));
    Means own{{}, by_tissue_.back().stiffening};
    if (model.is_deformable(tissue)) own.relaxed.add(tissue.relaxation, model.relaxation_times, 1);
    std::size_t kind = 0;
    while (kind < distinct_means_.size() && (distinct_means_[kind].relaxed.of_time != own.relaxed.of_time ||
                                             distinct_means_[kind].stiffening != own.stiffening))
      ++kind;
    if (kind == distinct_means_.size()) distinct_means_.push_back(own);
    kind_of_tissue.push_back(static_cast<std::uint8_t>(kind));
  }

  const ElasticLayout& layout = grid.layout();
  const ElasticBox& box = grid.box();
  const Transform<Voxel, Patient> X_VoxelPatient = labels.original->geometry().X_PatientVoxel().inverse();
  const auto tissue_at = [&](double i, double j, double k) {
    const Point<Patient> at = box.patient(Eigen::Vector3d(i, j, k) * box.cell_mm);
    return soft_tissue(model, *labels.original, X_VoxelPatient * at);
  };
  bool any = false;
  for (int k = 0; k < layout.cells[2]; ++k)
    for (int j = 0; j < layout.cells[1]; ++j)
      for (int i = 0; i < layout.cells[0]; ++i) {
        int tissue = tissue_at(i + 0.5, j + 0.5, k + 0.5);
        for (int corner = 0; corner < 8 && tissue < 0; ++corner)
          tissue = tissue_at(i + 0.1 + 0.8 * (corner & 1), j + 0.1 + 0.8 * (corner >> 1 & 1),
                             k + 0.1 + 0.8 * (corner >> 2));
        if (tissue < 0) continue;
        const std::uint8_t kind = kind_of_tissue[static_cast<std::size_t>(tissue)];
        means_of_cell_[layout.cell(i, j, k)] = kind;
        is_uniform_ = is_uniform_ && (!any || kind == first_);
        first_ = any ? first_ : kind;
        any = true;
      }
}

RelaxationWeights::Means RelaxationWeights::under(const ElasticGrid& grid,
                                                  const ElasticField& displaced_mm) const {
  if (is_uniform_) return distinct_means_[first_];
  const ElasticLayout& layout = grid.layout();
  std::vector<double> energy(distinct_means_.size(), 0.0);
  for (int k = 0; k < layout.cells[2]; ++k)
    for (int j = 0; j < layout.cells[1]; ++j) {
      const RowEnergy row(grid, displaced_mm.values, j, k);
      const std::uint8_t* kind = means_of_cell_.data() + layout.cell(0, j, k);
      for (int i = 0; i < layout.cells[0]; ++i) energy[kind[i]] += row.of(i);
    }
  double all = 0;
  for (const double one : energy) all += one;
  Means means;
  if (!(all > 0)) return means;
  for (std::size_t kind = 0; kind < distinct_means_.size(); ++kind) {
    means.relaxed.add(distinct_means_[kind].relaxed, energy[kind] / all);
    means.stiffening += distinct_means_[kind].stiffening * (energy[kind] / all);
  }
  return means;
}

bool RelaxationWeights::was_made_from(const Model& model) const {
  return std::equal(by_tissue_.begin(), by_tissue_.end(), model.tissues.begin(), model.tissues.end(),
                    [&](const TissueKey& was, const Tissue& tissue) { return was == of(model, tissue); });
}

}  // namespace palpate
