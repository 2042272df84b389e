#include <cmath>
#include <limits>

#include "phantoms/phantom_plan.h"
#include "phantoms/phantom_variation.h"

// Left temporal bone around a mastoid; +x lateral, +y posterior, +z superior. Positions are relative to the
// suprameatal spine (Henle), at the posterosuperior margin of the ear canal on the lateral surface of the
// bone. The sources of the dimensions are listed in docs/reference/temporal-bone.md; a dimension with a
// published spread is drawn within about one standard deviation of its mean.
namespace palpate {
namespace {

using P = Point<Patient>;
using V = Vector<Patient>;

constexpr double kCanalWall_mm = 1.6;   ///< Bony wall of the ear canal.
constexpr double kNerveCanal_mm = 1.2;  ///< Bone between the facial nerve and the air cells.
constexpr double kSeptum_mm = 0.5;      ///< Mean thickness of the septa between adjacent air cells.
constexpr double kSquama_mm = 4;        ///< Bone lateral to the dura of the fossae.
constexpr double kNerveRadius_mm = 0.9;

// the origin is medial to the spine by this, so that the volume is mirrored about x = 0
constexpr double kSpine_mm = 11;
P from_spine(double x, double y, double z) {
  return {x + kSpine_mm, y, z};
}

/// Dimensions of one patient, mm.
struct Dimensions {
  explicit Dimensions(std::uint64_t seed) {
    PhantomVariation chance(seed);
    canal_radius = 4.2 + chance.offset(0.4);
    canal_to_sinus = chance.within(10.5, 17.5, 14);
    sinus_radius = 5 + chance.offset(0.5);
    dura_height = 8 + chance.offset(2);
    antrum_depth = 15 + chance.offset(1.5);
    genu_depth = 13.8 + chance.offset(1.5);
    mastoid_segment = chance.within(13, 17, 15.1);
  }
  double canal_radius, canal_to_sinus, sinus_radius, dura_height, antrum_depth, genu_depth, mastoid_segment;
};

Shape tube(const std::vector<P>& course, double radius) {
  std::vector<Shape> segments;
  for (std::size_t n = 1; n < course.size(); ++n)
    segments.push_back(Shape::capsule(course[n - 1], course[n], radius));
  return Shape::unite(std::move(segments));
}

// the lateral surface is flat above and bulges over the mastoid process, whose tip is free
Shape outer_surface() {
  const Shape skull_base = Shape::box(from_spine(-60, 10, 49), {60, 70, 60});
  return Shape::blend({skull_base, Shape::ellipsoid(from_spine(-11.5, 11, -11), {10.2, 11.5, 17.5})}, 8);
}

Shape ear_canal(const Dimensions& size) {
  const double y = -0.4 - size.canal_radius;
  return Shape::capsule(from_spine(12, y, -4), from_spine(-12, y - 1, -4.5), size.canal_radius);
}

// tympanic cavity, epitympanum, aditus and antrum
Shape middle_ear(const Dimensions& size) {
  const P antrum = from_spine(-size.antrum_depth, 6, 3.2);
  return Shape::unite({Shape::ellipsoid(from_spine(-18.5, -5.5, -3.5), {2.6, 5, 6.5}),
                       Shape::ellipsoid(from_spine(-17, -3.5, 3), {3, 4, 2.8}),
                       Shape::capsule(from_spine(-16.5, -1, 3), antrum, 2),
                       Shape::ellipsoid(antrum, {3.2, 4.6, 3.2})});
}

Shape facial_nerve(const Dimensions& size) {
  const P genu = from_spine(-size.genu_depth, 2.6, -1.4);
  const P foramen = genu + V(1, 2.6, -size.mastoid_segment);
  return tube({from_spine(-22, -8, 2), genu, foramen, foramen + V(-5, -2, -9)}, kNerveRadius_mm);
}

Shape sigmoid_sinus(const Dimensions& size) {
  const double y = size.canal_to_sinus + size.sinus_radius;
  return tube({from_spine(-6, y + 24, 9), from_spine(-9.5, y + 4, 3), from_spine(-12, y, -5),
               from_spine(-17, y - 1, -11), from_spine(-26, y - 4, -9)},
              size.sinus_radius);
}

Shape ossicles() {
  const P malleus = from_spine(-16.3, -4.8, 3.4), incus = from_spine(-16.2, -2.9, 3.4),
          joint = from_spine(-17.8, -3.6, -0.4);
  return Shape::unite(
      {Shape::sphere(malleus, 1.3), Shape::capsule(malleus, from_spine(-17, -5.6, -2.4), 0.6),
       Shape::ellipsoid(incus, {1.4, 1.7, 1.5}), Shape::capsule(incus, from_spine(-15.6, 0.6, 2.9), 0.7),
       Shape::capsule(incus, joint, 0.55), Shape::capsule(joint, from_spine(-20, -3.6, -0.6), 0.6)});
}

// Air cells: balls at the nodes of a body-centred cubic lattice, displaced at random, so that some septa are
// perforated and others are thick. Their mean diameter is `cell_mm`.
Shape air_cells(const Shape& within, double cell_mm, std::uint64_t seed) {
  // seed 0 does not vary, but cells are never regular
  PhantomVariation chance(seed == 0 ? std::numeric_limits<std::uint64_t>::max() : seed);
  const double pitch = (cell_mm + kSeptum_mm) * 2 / std::sqrt(3.0);
  std::vector<Shape> balls;
  const auto steps = [&](double length) { return static_cast<int>(std::ceil(length / pitch)); };
  for (int i = 0; i < steps(22); ++i)
    for (int j = 0; j < steps(28); ++j)
      for (int k = 0; k < steps(34); ++k)
        for (const double half : {0.0, 0.5}) {
          const V displacement(chance.offset(0.2), chance.offset(0.2), chance.offset(0.2));
          const P middle =
              from_spine(-20, -5, -22) + pitch * (V(i + half, j + half, k + half) + displacement);
          const double radius = 0.5 * cell_mm * chance.factor(0.15);
          if (within.distance_mm(middle) < 0.5 * radius) balls.push_back(Shape::sphere(middle, radius));
        }
  return Shape::unite(std::move(balls));
}

}  // namespace

PhantomField field_of(const TemporalBoneParameters&) {
  return {{40, 50, 46}, {0, 9, -8}};
}

PhantomPlan plan_of(const TemporalBoneParameters& bone) {
  using enum PhantomMaterial;
  PhantomPlan plan;
  plan.field = field_of(bone);
  plan.imaging = PhantomImaging::kCt;
  plan.mirrored = bone.side == BodySide::kRight;
  const Dimensions size(bone.settings.seed);

  const Shape outer = outer_surface();
  const Shape canal = ear_canal(size);
  const Shape spaces = Shape::unite({canal, middle_ear(size)});
  const Shape nerve = facial_nerve(size), sinus = sigmoid_sinus(size);
  // dura of the middle fossa, whose floor falls towards the midline, and of the posterior fossa behind the
  // sinus
  const Shape middle_fossa =
      Shape::half_space(from_spine(-10, 0, size.dura_height), V(0.1, 0, -1).normalized());
  const Shape posterior_fossa = Shape::half_space(
      from_spine(-18, size.canal_to_sinus + size.sinus_radius - 1, 0), V(0.55, -0.83, 0).normalized());
  const Shape fossae = Shape::unite({middle_fossa, posterior_fossa});
  const Shape dura = Shape::intersect(fossae, Shape::offset(outer, -kSquama_mm));

  // the cavity of a cortical mastoidectomy ends at plates of bone over what has to be spared
  const Shape spared =
      Shape::unite({Shape::offset(fossae, bone.plate_mm), Shape::offset(sinus, bone.plate_mm),
                    Shape::offset(canal, kCanalWall_mm), Shape::offset(nerve, kNerveCanal_mm)});
  const P middle = from_spine(-8, 9.5, -4);
  const Shape below_cortex = Shape::offset(outer, -bone.cortex_mm);
  const Shape cavity =
      Shape::subtract(Shape::intersect(Shape::ellipsoid(middle, {11, 12, 15}), below_cortex), spared);
  // lateral to the cavity, through the whole cortex
  const Shape column =
      Shape::intersect(Shape::ellipsoid(from_spine(0, middle.y(), middle.z()), {9, 11.5, 14.5}), outer);
  const Shape cortex = Shape::subtract(Shape::subtract(column, below_cortex), spared);
  const Shape voids =
      bone.cells_mm > 0
          ? Shape::unite(
                {spaces, Shape::intersect(air_cells(cavity, bone.cells_mm, bone.settings.seed), cavity)})
          : spaces;

  const auto solid = [&](const Shape& shape) { return Shape::subtract(shape, voids); };
  plan.parts = {
      {"temporal_bone", 1, {227, 218, 201}, kBone, solid(outer)},
      {"dura_plate",
       5,
       {180, 190, 215},
       kBone,
       solid(Shape::intersect(Shape::offset(fossae, bone.plate_mm), Shape::offset(outer, -kSquama_mm)))},
      {"ear_canal_wall",
       4,
       {190, 200, 170},
       kBone,
       solid(Shape::intersect(Shape::offset(canal, kCanalWall_mm), outer))},
      {"mastoid_cortex", 2, {214, 196, 160}, kBone, solid(cortex)},
      {"mastoid_cells", 3, {240, 224, 190}, kBone, solid(cavity)},
      {"dura", 6, {215, 150, 150}, kBrain, dura},
      {"sigmoid_sinus", 7, {70, 90, 190}, kVessel, Shape::intersect(sinus, outer)},
      {"facial_nerve", 8, {250, 238, 60}, kMuscle, nerve},
      {"ossicles", 9, {235, 235, 235}, kBone, ossicles()},
  };
  return plan;
}

}  // namespace palpate
