#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "palpate/volume/gaussian_kernel.h"
#include "rendering/volume_terms.h"

/// Reference implementation of volume rendering: ray by ray, in double, without optimisation. volume_terms.h
/// defines the optical model.
namespace palpate::testing {

struct OracleVoxel {
  double extinction = 0;  ///< 1/mm
  Eigen::Vector3d colour = Eigen::Vector3d::Zero(), normal = Eigen::Vector3d::Zero();
};

class VolumeOracle {
 public:
  VolumeOracle(const Volume<LabelId>& labels, const std::vector<StructureAppearance>& appearances,
               const ScanAppearance& scan = {})
      : grid_(labels.geometry()), labels_(labels), appearances_(appearances), voxels_(grid_.voxel_count()) {
    namespace terms = internal::volume_picture;
    const Eigen::Matrix3d to_patient = grid_.X_PatientVoxel().linear().inverse().transpose();
    const std::vector<double> smooth = smoothed_opacity();
    const auto at = [&](int i, int j, int k) {
      return grid_.contains(i, j, k) ? grid_.offset(i, j, k) : voxels_.size();
    };
    for_each_voxel([&](int i, int j, int k) {
      OracleVoxel& voxel = voxels_[at(i, j, k)];
      std::map<LabelId, double> coverage;
      Eigen::Vector3d slope = Eigen::Vector3d::Zero();
      for (int c = -1; c <= 1; ++c)
        for (int b = -1; b <= 1; ++b)
          for (int a = -1; a <= 1; ++a) {
            const LabelId label = labels_.at_or(i + a, j + b, k + c, 0);
            if (opacity(label) == 0) continue;
            const double wa = a == 0 ? 0.5 : 0.25, wb = b == 0 ? 0.5 : 0.25, wc = c == 0 ? 0.5 : 0.25;
            coverage[label] += wa * wb * wc;
            slope += Eigen::Vector3d(a * wb * wc, b * wa * wc, c * wa * wb) / 2;
          }
      double all = 0, solid = 0;
      for (const auto& [label, o] : coverage) {
        all += o;
        if (opacity(label) == 1) solid += o;
      }
      const double solidity = terms::solidity(solid, opacity(labels_.at(i, j, k)) == 1);
      const double steep = (to_patient * slope).norm();
      for (const auto& [label, o] : coverage) {
        const double opaque = opacity(label);
        const double e = opaque == 1
                             ? terms::kSolidDepth / grid_.min_spacing_mm() * solidity * o / solid
                             : o * (terms::haze_per_mm(opaque) + terms::surface_depth(opaque) * steep / all);
        const Rgb& colour = appearances_[label].colour;
        voxel.extinction += e;
        voxel.colour += e * Eigen::Vector3d(colour.r, colour.g, colour.b);
      }
      if (voxel.extinction == 0) return add_scan(voxel, scan, all, i, j, k);
      voxel.colour /= voxel.extinction;
      // the smoothed opacity is available one voxel beyond the grid
      const Eigen::Vector3d rise(smooth[wide(i + 1, j, k)] - smooth[wide(i - 1, j, k)],
                                 smooth[wide(i, j + 1, k)] - smooth[wide(i, j - 1, k)],
                                 smooth[wide(i, j, k + 1)] - smooth[wide(i, j, k - 1)]);
      const Eigen::Vector3d gradient = to_patient * rise / 2;
      const double smallest = terms::kFaintGradient * terms::surface_gradient_per_mm(grid_);
      voxel.normal = gradient / std::max(gradient.norm(), smallest) * terms::sidedness(smooth[wide(i, j, k)]);
      add_scan(voxel, scan, all, i, j, k);
    });
  }

  struct Picture {
    std::vector<Eigen::Vector3d> rgb;  ///< 0 ... 255
    std::vector<double> covered;       ///< 0 ... 1
    std::vector<double> depth_mm;
  };
  /// @param steps  samples per shortest voxel edge
  Picture render(const VolumeCamera& camera, const VolumeStyle& style, double steps = 8) {
    light(camera, style);
    const auto X_VoxelPatient = grid_.X_PatientVoxel().inverse();
    const double step_mm = grid_.min_spacing_mm() / steps;
    Picture picture;
    for (int row = 0; row < camera.height_px; ++row)
      for (int column = 0; column < camera.width_px; ++column) {
        Point<Patient> from = camera.at(column, row);
        Vector<Patient> direction = camera.into();
        double min_mm = -std::numeric_limits<double>::infinity();
        if (!camera.is_parallel()) {
          const Point<Patient> eye = camera.focus - camera.into() * camera.eye_mm;
          direction = (from - eye).normalized();
          from = eye;
          min_mm = 0;
        }
        cast((X_VoxelPatient * from).eigen(), (X_VoxelPatient * direction).eigen(), from, direction, min_mm,
             step_mm, style, picture);
      }
    return picture;
  }

  const OracleVoxel& voxel(int i, int j, int k) const { return voxels_[grid_.offset(i, j, k)]; }

 private:
  static void add_scan(OracleVoxel& voxel, const ScanAppearance& scan, double covered, int i, int j, int k) {
    namespace terms = internal::volume_picture;
    if (scan.scan == nullptr) return;
    const double value = terms::value_in_window(scan.scan->at(i, j, k), scan.window);
    const double e = terms::scan_per_mm(value, covered, scan.opacity);
    if (e == 0) return;
    voxel.colour =
        (voxel.colour * voxel.extinction + Eigen::Vector3d::Constant(terms::scan_grey(value)) * e) /
        (voxel.extinction + e);
    voxel.extinction += e;
  }
  template <class Visit>
  void for_each_voxel(const Visit& visit) const {
    for (int k = 0; k < grid_.dims[2]; ++k)
      for (int j = 0; j < grid_.dims[1]; ++j)
        for (int i = 0; i < grid_.dims[0]; ++i) visit(i, j, k);
  }
  double opacity(LabelId label) const {
    return label > 0 && label < appearances_.size() ? appearances_[label].opacity : 0;
  }
  // index in the grid padded by one voxel on every side
  std::size_t wide(int i, int j, int k) const {
    const std::array<int, 3>& n = grid_.dims;
    return static_cast<std::size_t>(i + 1) +
           (n[0] + 2ul) * (static_cast<std::size_t>(j + 1) + (n[1] + 2ul) * static_cast<std::size_t>(k + 1));
  }

  std::vector<double> smoothed_opacity() const {
    namespace terms = internal::volume_picture;
    const std::array<int, 3>& n = grid_.dims;
    std::vector<double> values((n[0] + 2ul) * (n[1] + 2ul) * (n[2] + 2ul));
    for_each_voxel([&](int i, int j, int k) { values[wide(i, j, k)] = opacity(labels_.at(i, j, k)); });
    const auto sigma = internal::sigma_in_voxels(grid_, terms::normal_sigma_mm(grid_));
    for (int axis = 0; axis < 3; ++axis) {
      std::vector<double> gaussian;
      for (const float w : terms::sample_normal_kernel((*sigma)[axis]).weights) gaussian.push_back(w);
      for (const std::vector<double>& kernel : {std::vector<double>{0.5, 0.25}, gaussian}) {
        std::vector<double> next(values.size());
        for (int k = -1; k <= n[2]; ++k)
          for (int j = -1; j <= n[1]; ++j)
            for (int i = -1; i <= n[0]; ++i) {
              const int reach = static_cast<int>(kernel.size()) - 1;
              double sum = 0;
              for (int t = -reach; t <= reach; ++t) {
                std::array<int, 3> at{i, j, k};
                at[axis] += t;
                if (at[axis] < -1 || at[axis] > n[axis]) continue;
                sum += kernel[std::abs(t)] * values[wide(at[0], at[1], at[2])];
              }
              next[wide(i, j, k)] = sum;
            }
        values = next;
      }
    }
    return values;
  }

  void light(const VolumeCamera& camera, const VolumeStyle& style) {
    const Eigen::Vector3d into = camera.into().eigen();
    const Eigen::Vector3d from_key = -internal::volume_picture::direction_to_key(camera, style.light).eigen();
    lit_.resize(voxels_.size());
    for (std::size_t n = 0; n < voxels_.size(); ++n) {
      const OracleVoxel& voxel = voxels_[n];
      const double facing = std::abs(voxel.normal.dot(into)) + 1 - voxel.normal.norm();
      const double key = std::max(0.0, voxel.normal.dot(from_key)) +
                         std::max(0.0, into.dot(from_key)) * (1 - voxel.normal.norm());
      lit_[n] = voxel.colour * (style.light.ambient + style.light.diffuse * facing + style.light.key * key) +
                Eigen::Vector3d::Constant(255 * style.light.specular *
                                          std::pow(facing, internal::volume_picture::kShininess));
    }
  }

  /// @param origin, along  voxel coordinates; `along` per mm
  void cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& along, const Point<Patient>& from,
            const Vector<Patient>& direction, double min_mm, double step_mm, const VolumeStyle& style,
            Picture& picture) const {
    // path through the volume and one voxel beyond, where extinction fades
    double begin = min_mm, end = std::numeric_limits<double>::infinity();
    for (int axis = 0; axis < 3; ++axis) {
      if (along[axis] == 0) {
        if (origin[axis] <= -1 || origin[axis] >= grid_.dims[axis]) end = begin;
        continue;
      }
      const double a = (-1 - origin[axis]) / along[axis], b = (grid_.dims[axis] - origin[axis]) / along[axis];
      begin = std::max(begin, std::min(a, b));
      end = std::min(end, std::max(a, b));
    }
    // exactly to the clip plane, since an opaque structure absorbs everything within less than a step
    if (style.clip) {
      const double rise = direction.dot(style.clip->away),
                   here = (from - style.clip->at).dot(style.clip->away);
      if (rise == 0 && here > 0) end = begin;
      if (rise > 0) end = std::min(end, -here / rise);
      if (rise < 0) begin = std::max(begin, -here / rise);
    }
    Eigen::Vector3d rgb = Eigen::Vector3d::Zero();
    double clear = 1, depth = std::numeric_limits<double>::infinity();
    const long count = begin < end ? std::lround(std::ceil((end - begin) / step_mm)) : 0;
    if (count > 0) step_mm = (end - begin) / static_cast<double>(count);
    for (long n = 0; n < count && clear > 1e-6; ++n) {
      const double t = begin + (static_cast<double>(n) + 0.5) * step_mm;
      const Eigen::Vector3d at = origin + along * t;
      double extinction = 0;
      Eigen::Vector3d light = Eigen::Vector3d::Zero();
      const std::array<int, 3> low{static_cast<int>(std::floor(at[0])), static_cast<int>(std::floor(at[1])),
                                   static_cast<int>(std::floor(at[2]))};
      for (int corner = 0; corner < 8; ++corner) {
        double weight = 1;
        std::array<int, 3> c{};
        for (int axis = 0; axis < 3; ++axis) {
          const int far = corner >> axis & 1;
          c[axis] = low[axis] + far;
          weight *= far == 1 ? at[axis] - low[axis] : 1 - (at[axis] - low[axis]);
        }
        if (!grid_.contains(c[0], c[1], c[2])) continue;
        const std::size_t voxel = grid_.offset(c[0], c[1], c[2]);
        if (voxels_[voxel].extinction == 0) continue;
        extinction += weight * voxels_[voxel].extinction;
        light += weight * voxels_[voxel].extinction * lit_[voxel];
      }
      if (extinction == 0) continue;
      const double after = clear * std::exp(-extinction * step_mm);
      rgb += (clear - after) / extinction * light;
      if (clear > 0.5 && after <= 0.5) depth = t;
      clear = after;
    }
    const Rgb& ground = style.background;
    picture.rgb.emplace_back(rgb + clear * Eigen::Vector3d(ground.r, ground.g, ground.b));
    picture.covered.push_back(1 - clear);
    picture.depth_mm.push_back(depth);
  }

  GridGeometry grid_;
  const Volume<LabelId>& labels_;
  std::vector<StructureAppearance> appearances_;
  std::vector<OracleVoxel> voxels_;
  std::vector<Eigen::Vector3d> lit_;
};

}  // namespace palpate::testing
