#include "phantoms/segmentation_noise.h"

#include <algorithm>
#include <cmath>
#include <random>

#include "palpate/base/hash.h"

namespace palpate {
namespace {

constexpr double kCorrelation_mm = 5;
// limit of each component, in standard deviations
constexpr double kMaxSigmas = 3;
constexpr double kMaxDisc_mm = 1.5;

std::uint64_t mixed(std::initializer_list<std::uint64_t> words) {
  std::uint64_t state = kHashSeed;
  for (const std::uint64_t word : words) hash_word(state, word);
  return hash_finish(state);
}

// Sum of uniform numbers: approximately Gaussian with variance 1, and identical on every machine.
double nearly_gaussian(std::uint64_t bits) {
  double sum = 0;
  for (int i = 0; i < 4; ++i) {
    sum += static_cast<double>(bits & 0xffff) / 65535.0 - 0.5;
    bits >>= 16;
  }
  return sum * std::sqrt(3.0);
}

std::uint64_t word_of(int value) {
  return static_cast<std::uint64_t>(static_cast<std::int64_t>(value));
}

// Random numbers that do not depend on the standard library.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : random_(seed) {}
  double unit() { return static_cast<double>(random_() >> 11) * 0x1.0p-53; }
  int below(int n) { return std::min(static_cast<int>(unit() * n), n - 1); }

 private:
  std::mt19937_64 random_;
};

// voxels of a disc in one slice
struct Disc {
  std::vector<std::array<int, 3>> voxels;
};

class DiscPlacer {
 public:
  DiscPlacer(Volume<LabelId>& labels, std::uint64_t seed)
      : labels_(labels), grid_(labels.geometry()), axis_(slice_axis(grid_)), dice_(mixed({seed, 0x15})) {}

  // islands need a neighbourhood of background, holes one of a single structure
  bool cut_hole() {
    return try_often([&](const std::array<int, 3>& centre) {
      const LabelId here = value(centre);
      return here != 0 && place_disc(disc_at(centre), here, 0);
    });
  }
  bool add_island() {
    return try_often([&](const std::array<int, 3>& centre) {
      if (value(centre) != 0) return false;
      const LabelId owner = nearby_structure(centre);
      return owner != 0 && place_disc(disc_at(centre), 0, owner);
    });
  }

 private:
  LabelId value(const std::array<int, 3>& v) const { return labels_.at(v[0], v[1], v[2]); }

  template <class Try>
  bool try_often(const Try& attempt) {
    for (int n = 0; n < 20'000; ++n)
      if (attempt({dice_.below(grid_.dims[0]), dice_.below(grid_.dims[1]), dice_.below(grid_.dims[2])}))
        return true;
    return false;
  }

  Disc disc_at(const std::array<int, 3>& centre) {
    const double radius = kMaxDisc_mm * dice_.unit();
    Disc disc;
    std::array<int, 3> reach{0, 0, 0};
    for (int a = 0; a < 3; ++a)
      if (a != axis_) reach[at(a)] = static_cast<int>(radius / grid_.spacing_mm[a]);
    for (int k = -reach[2]; k <= reach[2]; ++k)
      for (int j = -reach[1]; j <= reach[1]; ++j)
        for (int i = -reach[0]; i <= reach[0]; ++i) {
          const Eigen::Vector3d step = grid_.spacing_mm.cwiseProduct(Eigen::Vector3d(i, j, k));
          if (step.norm() <= radius || (i == 0 && j == 0 && k == 0))
            disc.voxels.push_back({centre[0] + i, centre[1] + j, centre[2] + k});
        }
    return disc;
  }

  // first structure along a random direction within the slice, at most kFar_mm away
  LabelId nearby_structure(const std::array<int, 3>& centre) {
    constexpr double kFar_mm = 8;
    const int a = axis_ == 0 ? 1 : 0, b = axis_ == 2 ? 1 : 2;
    const int axis = dice_.below(2) == 0 ? a : b, sign = dice_.below(2) == 0 ? -1 : 1;
    std::array<int, 3> v = centre;
    for (double distance = 0; distance < kFar_mm; distance += grid_.spacing_mm[axis]) {
      v[at(axis)] += sign;
      if (!grid_.contains(v[0], v[1], v[2])) return 0;
      if (value(v) != 0) return value(v);
    }
    return 0;
  }

  bool place_disc(const Disc& disc, LabelId around, LabelId label) {
    for (const auto& [x, y, z] : disc.voxels)
      for (int k = z - 1; k <= z + 1; ++k)
        for (int j = y - 1; j <= y + 1; ++j)
          for (int i = x - 1; i <= x + 1; ++i)
            if (!grid_.contains(i, j, k) || labels_.at(i, j, k) != around) return false;
    for (const auto& [x, y, z] : disc.voxels) labels_.at(x, y, z) = label;
    return true;
  }

  static std::size_t at(int axis) { return static_cast<std::size_t>(axis); }

  Volume<LabelId>& labels_;
  const GridGeometry& grid_;
  int axis_;
  Dice dice_;
};

}  // namespace

int slice_axis(const GridGeometry& grid) {
  int widest = 2;
  for (const int axis : {1, 0})
    if (grid.spacing_mm[axis] > grid.spacing_mm[widest]) widest = axis;
  return widest;
}

BorderJitter::BorderJitter(const GridGeometry& grid, double sigma_mm, std::uint64_t seed)
    : axis_(slice_axis(grid)), sigma_mm_(sigma_mm), seed_(seed) {}

double BorderJitter::max_mm() const {
  return std::sqrt(2.0) * kMaxSigmas * sigma_mm_;
}

// lattice noise, interpolated and normalised to variance 1 everywhere
double BorderJitter::component(int which, double u_mm, double v_mm, int slice) const {
  const double u = u_mm / kCorrelation_mm, v = v_mm / kCorrelation_mm;
  const double fu = u - std::floor(u), fv = v - std::floor(v);
  const auto smooth = [](double t) { return t * t * (3 - 2 * t); };
  double sum = 0, squares = 0;
  for (const int cu : {0, 1}) {
    for (const int cv : {0, 1}) {
      const double weight = smooth(cu == 1 ? fu : 1 - fu) * smooth(cv == 1 ? fv : 1 - fv);
      sum += weight * nearly_gaussian(mixed({seed_, word_of(which), word_of(slice),
                                             word_of(static_cast<int>(std::floor(u)) + cu),
                                             word_of(static_cast<int>(std::floor(v)) + cv)}));
      squares += weight * weight;
    }
  }
  return sum / std::sqrt(squares);
}

Eigen::Vector3d BorderJitter::displacement_mm(const Eigen::Vector3d& p_mm, int slice) const {
  const int a = axis_ == 0 ? 1 : 0, b = axis_ == 2 ? 1 : 2;
  Eigen::Vector3d displacement = Eigen::Vector3d::Zero();
  int which = 0;
  for (const int axis : {a, b}) {
    const double here = component(which, p_mm[a], p_mm[b], slice);
    const double before = component(which, p_mm[a], p_mm[b], slice - 1);
    displacement[axis] = sigma_mm_ * std::clamp((here + before) / std::sqrt(2.0), -kMaxSigmas, kMaxSigmas);
    ++which;
  }
  return displacement;
}

void add_islands_and_holes(Volume<LabelId>& labels, std::uint64_t count, std::uint64_t seed) {
  DiscPlacer placer(labels, seed);
  for (std::uint64_t n = 0; n < count; ++n) {
    // once no space was found, further attempts are unlikely to succeed
    if (!placer.cut_hole()) break;
  }
  for (std::uint64_t n = 0; n < count; ++n)
    if (!placer.add_island()) break;
}

}  // namespace palpate
