#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "palpate/direct/direct_methods.h"

namespace palpate {
namespace {

// Gradients below this are rounding errors, e.g. of a spline with equal coefficients; one step of a 16-bit
// field between adjacent voxels is about ten times as steep. Normalising them would give a full force in a
// random direction.
constexpr double kFlat_per_mm = 1e-6;

Error nothing_touchable() {
  return {ErrorKind::kBadInput, "no structure is touchable, so the method has nothing to sample", "",
          "set touchable = true on a tissue"};
}

Result<GaussianSphere> gaussian_of(const Model& model, LabelVoxels voxels) {
  return GaussianSphere::make(std::move(voxels), model.method_settings.sphere_sigma_voxels);
}

Result<SmoothSphere> smooth_of(const Model& model, LabelVoxels voxels) {
  // an unsmoothed field still has spheres of the minimum radius
  constexpr double kMinSigma_mm = 1e-6;
  return SmoothSphere::make(std::move(voxels), std::max(model.sigma_mm, kMinSigma_mm));
}

// touchable labels by level
std::map<double, LabelSet> labels_by_level(const Model& model) {
  std::map<double, LabelSet> by_level;
  for (std::size_t id = 1; id < model.level_of_label.size(); ++id)
    if (const double level = model.level_of_label[id]; level > 0)
      by_level[level].insert(static_cast<LabelId>(id));
  return by_level;
}

template <class Sphere, class Make>
Result<LevelledSphere<Sphere>> make_levelled(const Model& model, const Make& make) {
  std::vector<typename LevelledSphere<Sphere>::Part> parts;
  const auto by_level = labels_by_level(model);
  double below = 0;
  for (auto level = by_level.begin(); level != by_level.end(); ++level) {
    LabelSet this_and_harder;
    for (auto harder = level; harder != by_level.end(); ++harder)
      for (const LabelRange& range : harder->second.ranges())
        for (int id = range.first; id <= range.last; ++id) this_and_harder.insert(static_cast<LabelId>(id));
    // every range of labels is tested for every voxel, so several ranges are replaced by a mask
    auto sphere = make(this_and_harder.ranges().size() > 1 ? LabelVoxels::mask(*model.labels, this_and_harder)
                                                           : LabelVoxels(model.labels, this_and_harder));
    if (!sphere) return sphere.error();
    parts.push_back({level->first - below, *std::move(sphere)});
    below = level->first;
  }
  if (parts.empty()) return nothing_touchable();
  return LevelledSphere<Sphere>(std::move(parts));
}

std::shared_ptr<const ForceField> force_field(ForceField::Source source, double full_force_N) {
  return std::make_shared<const ForceField>(std::move(source), full_force_N);
}

Result<std::shared_ptr<const ForceField>> make_gaussian(const Model& model) {
  auto sphere = make_levelled<GaussianSphere>(
      model, [&](LabelVoxels voxels) { return gaussian_of(model, std::move(voxels)); });
  if (!sphere) return sphere.error();
  // its sigma is in voxels, so the maximum slope is along the minimum spacing
  const GridGeometry& grid = model.labels->geometry();
  const double ramp = ramp_mm(model.method_settings.sphere_sigma_voxels * grid.min_spacing_mm(), grid);
  return force_field(*std::move(sphere), model.max_stiffness_N_per_mm() * ramp);
}

Result<std::shared_ptr<const ForceField>> make_smooth(const Model& model) {
  auto sphere = make_levelled<SmoothSphere>(
      model, [&](LabelVoxels voxels) { return smooth_of(model, std::move(voxels)); });
  if (!sphere) return sphere.error();
  const double ramp = ramp_mm(sphere->parts().front().sphere.min_sigma_mm(), model.labels->geometry());
  return force_field(*std::move(sphere), model.max_stiffness_N_per_mm() * ramp);
}

StoredNormals stored_normals_of(const Field& field, NormalEncoding encoding) {
  return std::visit([&](const auto& ramp) { return StoredNormals::from_ramp(ramp, encoding); },
                    field.storage());
}

template <class Parts, class SampleOf>
FieldSample weighted_sum(const Parts& parts, const SampleOf& sample_of) {
  FieldSample sum;
  for (const auto& part : parts) {
    const FieldSample sample = sample_of(part.sphere);
    sum.value += part.weight * sample.value;
    sum.gradient += sample.gradient * part.weight;
  }
  return sum;
}

}  // namespace

template <class Sphere>
FieldSample LevelledSphere<Sphere>::sample(const Point<Patient>& x) const {
  return weighted_sum(parts_, [&](const Sphere& sphere) { return sphere.sample(x); });
}

template <class Sphere>
FieldSample LevelledSphere<Sphere>::sample_literal(const Point<Patient>& x) const {
  return weighted_sum(parts_, [&](const Sphere& sphere) { return sphere.sample_literal(x); });
}

template class LevelledSphere<GaussianSphere>;
template class LevelledSphere<SmoothSphere>;

FieldSample ForceField::sample(const Point<Patient>& x) const {
  struct Sampler {
    const Point<Patient>& x;
    FieldSample operator()(const std::shared_ptr<const Field>& field) const {
      return sample_central_differences(*field, x);
    }
    // negative overshoots of the spline would pull; a value within rounding error of a coefficient counts as
    // 0
    FieldSample operator()(const SplineField& field) const {
      const FieldSample sample = sample_spline(field, x);
      const double rounding = field.bytes_per_voxel() == 2 ? field.scale() : 0;
      return sample.value > rounding ? sample : FieldSample{};
    }
    FieldSample operator()(const LevelledSphere<GaussianSphere>& sphere) const { return sphere.sample(x); }
    FieldSample operator()(const LevelledSphere<SmoothSphere>& sphere) const { return sphere.sample(x); }
    FieldSample operator()(const StoredNormals& normals) const { return normals.sample(x); }
  };
  FieldSample sample = std::visit(Sampler{x}, source_);
  if (sample.gradient.squared_norm() < kFlat_per_mm * kFlat_per_mm) sample.gradient = {};
  return sample;
}

double ramp_mm(double sigma_mm, const GridGeometry& grid) {
  return std::max(sigma_mm * std::sqrt(2 * std::numbers::pi), grid.min_spacing_mm());
}

Vector<Patient> normal_force(const FieldSample& sample, double full_force_N) {
  return sample.gradient.normalized() * (-full_force_N * sample.value);
}

Result<std::shared_ptr<const ForceField>> make_force_field(const Model& model, ForceMethod method) {
  const double width_mm =
      model.ramp_width_mm > 0 ? model.ramp_width_mm : ramp_mm(model.sigma_mm, model.labels->geometry());
  const double of_field_N = model.max_stiffness_N_per_mm() * width_mm;
  switch (method) {
    case ForceMethod::kTrilinear:
      return force_field(model.field, of_field_N);
    case ForceMethod::kSpline:
      return force_field(SplineField(*model.field), of_field_N);
    case ForceMethod::kGaussianSphere:
      return make_gaussian(model);
    case ForceMethod::kSmoothSphere:
      return make_smooth(model);
    case ForceMethod::kProxy:
      break;
    case ForceMethod::kStoredNormals:
      return force_field(stored_normals_of(*model.field, model.method_settings.normals), of_field_N);
  }
  PALPATE_CHECK(false);
}

Result<void> check_force_field(const Model& model, ForceMethod method) {
  if (method != ForceMethod::kGaussianSphere && method != ForceMethod::kSmoothSphere) return {};
  if (labels_by_level(model).empty()) return nothing_touchable();
  const auto fits = [](const auto& sphere) { return sphere ? Result<void>() : Result<void>(sphere.error()); };
  LabelVoxels any(model.labels, LabelSet{1});
  return method == ForceMethod::kGaussianSphere ? fits(gaussian_of(model, std::move(any)))
                                                : fits(smooth_of(model, std::move(any)));
}

std::uint64_t memory_of_force_field(const Model& model, ForceMethod method) {
  const std::uint64_t voxels = model.labels->geometry().voxel_count();
  switch (method) {
    case ForceMethod::kTrilinear:
    case ForceMethod::kProxy:
      return 0;
    case ForceMethod::kSpline:
      // two copies of the coefficients and two of their quantised steps
      return 12 * voxels;
    case ForceMethod::kGaussianSphere:
    case ForceMethod::kSmoothSphere:
      // at most one mask of one byte per voxel for each level
      return labels_by_level(model).size() * model.labels->bytes() / sizeof(LabelId);
    case ForceMethod::kStoredNormals:
      return (model.field_in_eight_bits ? 5 : 6) * voxels;
  }
  PALPATE_CHECK(false);
}

Result<std::shared_ptr<const Model>> with_methods(std::shared_ptr<const Model> model,
                                                  std::span<const ForceMethod> methods,
                                                  const Progress& progress) {
  std::shared_ptr<Model> more;
  for (const ForceMethod method : methods) {
    if ((more ? *more : *model).has(method)) continue;
    if (progress.stopped()) return Progress::interrupted();
    progress.report("preparing " + std::string(name_of(method)), 0);
    auto field = make_force_field(*model, method);
    if (!field) return field.error();
    if (!more) more = std::make_shared<Model>(*model);
    more->methods[index_of(method)] = *std::move(field);
    progress.report("preparing " + std::string(name_of(method)), 1);
  }
  return more ? std::shared_ptr<const Model>(std::move(more)) : std::move(model);
}

}  // namespace palpate
