#include "phantoms/knee_phantom_anatomy.h"

#include <algorithm>
#include <numbers>
#include <utility>

#include "phantoms/phantom_variation.h"

// A left knee in extension, composed of ellipsoids, capsules, cylinders and tori. +x lateral, -y anterior, +z
// superior, mm. Cartilage is the shell between a bone and the same bone grown by the cartilage's thickness,
// cut to the articular surface; the opposite surface is cut back by the free gap between them. The gaps
// therefore hold everywhere, whatever the shapes below.
namespace palpate {
namespace {

using Eigen::Vector3d;

constexpr double kMeniscusGap_mm = 0.6;  ///< Free gap between a meniscus and its neighbours.
constexpr double kBoneGap_mm = 1.0;      ///< Free gap between tibia and fibula.

using P = Point<Patient>;
using V = Vector<Patient>;

// Rotation about the superior axis; a positive angle turns the posterior end to the right, medially.
Eigen::Matrix3d turned(double degrees) {
  return Eigen::AngleAxisd(degrees * std::numbers::pi / 180, Vector3d::UnitZ()).toRotationMatrix();
}

// capsules of one radius along a polyline
Shape chain(const std::vector<P>& points, double radius) {
  std::vector<Shape> links;
  for (std::size_t i = 1; i < points.size(); ++i) {
    links.push_back(Shape::capsule(points[i - 1], points[i], radius));
  }
  return Shape::unite(std::move(links));
}

// flat band of `count` parallel chains, `step` apart
Shape band(const std::vector<P>& points, double radius, const V& step, int count) {
  std::vector<Shape> strands;
  for (int n = 0; n < count; ++n) {
    std::vector<P> shifted;
    for (const P& p : points) shifted.push_back(p + (n - 0.5 * (count - 1)) * step);
    strands.push_back(chain(shifted, radius));
  }
  return Shape::blend(strands, 1.5 * radius);
}

Shape below(double z) {
  return Shape::half_space(P(0, 0, z), V(0, 0, 1));
}
Shape above(double z) {
  return Shape::half_space(P(0, 0, z), V(0, 0, -1));
}
Shape without(const Shape& from, const Shape& neighbour, double gap) {
  return Shape::subtract(from, Shape::offset(neighbour, gap));
}

// Trochlear groove in which the patella runs: the inner side of a torus about a transverse axis, which leaves
// the bone towards the condyles' contact with the tibia. `clearance` moves its surface outwards, so that the
// patella's facets are the same surface, farther out.
Shape pulley(double clearance) {
  const double groove = 27, across = 34;
  return Shape::torus(P(1, -1, 27), V(1, 0, 0), groove + across, across - clearance);
}

// fossa between the condyles, open posteriorly and inferiorly
Shape intercondylar_notch() {
  return Shape::blend(
      {Shape::capsule(P(0, 3, 3), P(0, 60, 3), 10.5), Shape::capsule(P(0, 9, 15), P(0, 60, 45), 9)}, 5);
}

Shape femur(const KneeShape& knee) {
  // varies in width and depth only: the height of the condyles determines the joint line
  const double m = knee.medial_condyle, l = knee.lateral_condyle;
  const Shape condyles =
      Shape::blend({Shape::ellipsoid(P(-22, -3, 24.5), {m * 14.5, m * 30, 22}, turned(8)),
                    Shape::ellipsoid(P(-24, 10, 23), {m * 13, m * 21, 20.5}),
                    Shape::ellipsoid(P(21.5, -5, 25), {l * 14.5, l * 30, 22.5}, turned(-5)),
                    Shape::ellipsoid(P(23, 9, 23), {l * 13, l * 20, 20.5})},
                   3);
  const Shape trochlea = Shape::offset(Shape::cylinder(P(-15, -13, 29), P(18, -13.5, 29), 14.5), 6);
  const Shape distal = Shape::subtract(Shape::blend({condyles, trochlea}, 4), pulley(0));
  const Shape shaft = Shape::blend(
      {Shape::capsule(P(3, -9, 100), P(0, -8, 46), 15.5), Shape::capsule(P(-4, -7, 54), P(-21, 0, 30), 14),
       Shape::capsule(P(4, -7, 54), P(20, 0, 30), 14), Shape::ellipsoid(P(-35, 3, 27), {6, 11, 10}),
       Shape::ellipsoid(P(34, 5, 25), {5.5, 9, 9})},
      8);
  return Shape::subtract(Shape::blend({distal, shaft}, 4), intercondylar_notch());
}

// shell on a bone that tapers towards the border of its region, where it is about 1 mm thick
Shape cartilage_layer(const Shape& bone, double thickness, const Shape& region) {
  const Shape tapered = Shape::intersect(Shape::offset(bone, thickness), region, 5);
  return Shape::subtract(Shape::intersect(tapered, Shape::offset(region, -1.5)), bone);
}

Shape femoral_cartilage(const KneeShape& knee, const Shape& bone) {
  // belt around the condyles and the trochlea, excluding the shaft, the epicondyles and the notch
  const Shape belt = Shape::box(P(0, 0, 16), {37, 60, 30});
  const Shape sides = Shape::unite(
      {Shape::capsule(P(-70, 4, 38), P(70, 4, 38), 21), Shape::half_space(P(0, 0, 43), V(0, 0.2, -1))});
  const Shape region = without(Shape::subtract(belt, sides), intercondylar_notch(), 0.5);
  return cartilage_layer(bone, knee.femoral_cartilage_mm, region);
}

// disc of the tibial plateau with a rounded rim
Shape plateau_disc(double x, double y, double radius, double top) {
  return Shape::offset(Shape::cylinder(P(x, y, -9), P(x, y, top - 4), radius - 4), 4);
}

Shape tibia() {
  const Shape plateau = Shape::blend({plateau_disc(-20.5, -5, 17.5, -0.9), plateau_disc(-19.5, 9, 17.5, -0.9),
                                      plateau_disc(20.5, -3, 17.5, -1.1), plateau_disc(21.5, 7, 16.5, -1.1),
                                      plateau_disc(0, -8, 18, -3.5), plateau_disc(0, 6, 14, -3.5)},
                                     4);
  const Shape facets =
      Shape::unite({Shape::sphere(P(-21, 1, 61.8), 65), Shape::sphere(P(21.5, 1, 86.8), 90)});
  const Shape spines = Shape::unite(
      {Shape::ellipsoid(P(-4.8, 1, -5), {4.2, 9, 8.6}), Shape::ellipsoid(P(5.2, 3, -5), {4, 7, 7.8})});
  const Shape head = Shape::blend({Shape::subtract(plateau, facets), spines}, 3);
  const Shape shaft = Shape::blend(
      {Shape::ellipsoid(P(-14, 1, -19), {22, 22, 21}), Shape::ellipsoid(P(15.5, 1, -19), {20.5, 20, 21}),
       Shape::ellipsoid(P(0, -4, -19), {26, 20, 22}), Shape::capsule(P(-11, 2, -26), P(-4, 0, -64), 14),
       Shape::capsule(P(13, 2, -26), P(-1, 0, -64), 14), Shape::capsule(P(-3, 0, -50), P(-4, 2, -110), 14),
       Shape::capsule(P(2, -16, -24), P(1, -13, -60), 8), Shape::ellipsoid(P(2, -19, -40), {11, 7, 17})},
      6);
  return Shape::blend({head, Shape::intersect(shaft, below(-5), 3)}, 6);
}

Shape tibial_cartilage(const KneeShape& knee, const Shape& bone, const Shape& femoral, const P& centre,
                       const Vector3d& radii) {
  const Shape layer = cartilage_layer(bone, knee.tibial_cartilage_mm, Shape::ellipsoid(centre, radii));
  return without(layer, femoral, knee.joint_gap_mm);
}

Shape fibula(const KneeShape& knee, const Shape& tibia_bone) {
  const V shift(knee.fibula_mm);
  const Shape bone = Shape::blend({Shape::ellipsoid(P(37, 19, -25) + shift, {8.5, 10, 11}),
                                   Shape::capsule(P(36.5, 19.5, -28) + shift, P(34, 20, -50) + shift, 6.2),
                                   Shape::capsule(P(34, 20, -50) + shift, P(33, 20, -110) + shift, 6.8)},
                                  6);
  return without(bone, tibia_bone, kBoneGap_mm);
}

Shape patella_body(const KneeShape& knee) {
  const double r = knee.patella, up = knee.patella_up_mm;
  return Shape::blend({Shape::ellipsoid(P(1, -41, 34 + up), {r * 21.5, r * 12, r * 18.5}),
                       Shape::ellipsoid(P(1, -44.5, 21 + up), {r * 10, r * 6.5, r * 9})},
                      5);
}

// distance of the patella's cartilage, and of its bone, from the femur
double patellar_surface_mm(const KneeShape& knee) {
  return knee.femoral_cartilage_mm + knee.joint_gap_mm;
}
double patellar_bone_mm(const KneeShape& knee) {
  return patellar_surface_mm(knee) + knee.patellar_cartilage_mm;
}

Shape patella(const KneeShape& knee) {
  return Shape::intersect(patella_body(knee), pulley(patellar_bone_mm(knee)));
}

Shape patellar_cartilage(const KneeShape& knee, const Shape& femoral) {
  const Shape facets = Shape::intersect(patella_body(knee), pulley(patellar_surface_mm(knee)));
  const Shape articular = Shape::intersect(Shape::subtract(facets, pulley(patellar_bone_mm(knee))),
                                           above(20 + knee.patella_up_mm));
  return without(articular, femoral, knee.joint_gap_mm);
}

// muscles, vessels and other soft tissue of a leg: visible in the scan only
std::vector<PhantomPart> surroundings() {
  using enum PhantomMaterial;
  const Shape skin = Shape::ellipsoid(P(0, 6, 0), {54, 63, 400});
  const std::vector<Shape> muscles = {
      Shape::ellipsoid(P(-32, -14, 66), {15, 20, 36}),                 // vastus medialis
      Shape::ellipsoid(P(31, -14, 76), {13, 19, 36}),                  // vastus lateralis
      chain({P(-14, 36, 100), P(-24, 36, 30), P(-27, 34, 0)}, 10),     // semimembranosus
      chain({P(-12, 50, 100), P(-30, 46, 0)}, 5),                      // semitendinosus
      chain({P(20, 40, 100), P(34, 33, 25), P(38, 27, -8)}, 8),        // biceps femoris
      chain({P(-40, 20, 100), P(-42, 27, 20), P(-38, 22, -30)}, 4.5),  // sartorius
      Shape::ellipsoid(P(-15, 45, -36), {19, 13, 60}),                 // gastrocnemius, medial head
      Shape::ellipsoid(P(19, 44, -40), {16, 13, 56}),                  // gastrocnemius, lateral head
      Shape::ellipsoid(P(-2, 26, -48), {22, 9, 30}),                   // popliteus
      Shape::ellipsoid(P(25, 2, -74), {12, 15, 36}),                   // tibialis anterior
      Shape::ellipsoid(P(42, 12, -74), {8, 13, 34}),                   // peroneus longus
  };
  const Shape quadriceps_tendon = band({P(1, -45, 48), P(2, -39, 75), P(2, -34, 110)}, 2.2, V(3.5, 0, 0), 7);
  return {
      {"skin", 0, {}, kMuscle, skin},
      {"fat", 0, {}, kFat, Shape::offset(skin, -1.5)},
      {"muscles", 0, {}, kMuscle, Shape::unite(muscles)},
      {"popliteal_artery", 0, {}, kVessel, chain({P(-2, 30, 110), P(1, 32, 0), P(3, 34, -110)}, 3)},
      {"popliteal_vein", 0, {}, kVessel, chain({P(3, 36, 110), P(6, 39, 0), P(6, 40, -110)}, 3.6)},
      {"quadriceps_tendon", 0, {}, kLigament, quadriceps_tendon},
      {"suprapatellar_pouch", 0, {}, kFluid, Shape::ellipsoid(P(2, -28.5, 53), {17, 2.2, 10})},
  };
}

}  // namespace

std::vector<PhantomPart> knee_phantom_parts(const KneeShape& knee) {
  using enum PhantomMaterial;
  const Rgb bone_colour{197, 189, 177}, cartilage_colour{180, 180, 255}, meniscus_colour{200, 205, 205},
      ligament_colour{255, 255, 255};

  // bones
  const Shape femur_bone = femur(knee);
  const Shape tibia_bone = tibia();
  const Shape fibula_bone = fibula(knee, tibia_bone);
  const Shape patella_bone = patella(knee);

  // cartilages
  const Shape femoral = femoral_cartilage(knee, femur_bone);
  const Shape medial_tibial = tibial_cartilage(knee, tibia_bone, femoral, P(-21, 2, -2.5), {17, 23.5, 9});
  const Shape lateral_tibial = tibial_cartilage(knee, tibia_bone, femoral, P(21.5, 2, -2.5), {17, 21.5, 9});
  const Shape patellar = patellar_cartilage(knee, femoral);

  // menisci: wedges that fill the space between the cartilages at the rim
  const Shape joint_surfaces = Shape::unite({femur_bone, tibia_bone, femoral, medial_tibial, lateral_tibial});
  const auto meniscus = [&](const P& centre, const Vector3d& outer, const Vector3d& inner,
                            const Shape& opening) {
    const Shape ring = Shape::subtract(Shape::ellipsoid(centre, outer), Shape::ellipsoid(centre, inner));
    return Shape::subtract(Shape::subtract(ring, opening), Shape::offset(joint_surfaces, kMeniscusGap_mm), 2);
  };
  const auto inner = [&](double outside, double mean) {
    return mean + (1 - knee.meniscus) * (outside - mean);
  };
  const Shape medial_meniscus =
      meniscus(P(-20.5, 2, 2), {19, 23.5, 8}, {inner(19, 10.5), inner(23.5, 14), 40},
               Shape::capsule(P(-12, 1, 0), P(30, 1, 0), 13));
  const Shape lateral_meniscus = meniscus(P(21, 1, 2), {18.5, 22, 8}, {inner(18.5, 9), inner(22, 11.5), 40},
                                          Shape::capsule(P(12, 2, 0), P(-30, 2, 0), 9));

  // ligaments: clear of the bones that they pass, and cut by those at which they end
  const Shape bones = Shape::unite({femur_bone, tibia_bone, fibula_bone, patella_bone});
  const Shape articular =
      Shape::unite({femoral, medial_tibial, lateral_tibial, patellar, medial_meniscus, lateral_meniscus});
  const auto ligament = [&](const Shape& course) {
    return without(Shape::subtract(course, bones), articular, kMeniscusGap_mm);
  };
  const Shape acl =
      ligament(chain({P(-1, -10, -4), P(1, -2, 5), P(5, 8, 12), P(9, 16, 19)}, knee.ligament * 4));
  const Shape pcl = without(
      ligament(chain({P(-1, 24, -12), P(-2, 21, -1), P(-4, 14, 6), P(-8.5, 3, 12)}, knee.ligament * 4.3)),
      acl, kMeniscusGap_mm);
  const Shape fcl =
      ligament(chain({P(40, 5, 25), P(43, 10, 12), P(43.5, 14, -2), P(40, 19, -18) + V(knee.fibula_mm)},
                     knee.ligament * 2.4));
  const Shape tcl = ligament(band(
      {P(-40, 3, 29), P(-42.5, 2, 16), P(-42.5, 1, 0), P(-40.5, 0, -14), P(-32, -2, -30), P(-24, -3, -48)},
      knee.ligament * 1.7, V(0, 2.2, 0), 5));
  const Shape patellar_ligament =
      ligament(band({P(1, -48, 22 + knee.patella_up_mm), P(1, -46, 12 + knee.patella_up_mm), P(2, -36, -18),
                     P(2, -27, -40)},
                    knee.ligament * 2, V(3.4, 0, 0), 7));

  // fluid between opposite surfaces of the joint
  const Shape opposite =
      Shape::unite({medial_tibial, lateral_tibial, patellar, medial_meniscus, lateral_meniscus});
  const Shape fluid =
      Shape::intersect(Shape::offset(femoral, knee.joint_gap_mm), Shape::offset(opposite, knee.joint_gap_mm));

  std::vector<PhantomPart> parts = surroundings();
  const std::vector<PhantomPart> joint = {
      {"joint_fluid", 0, {}, kFluid, fluid},
      {"anterior_cruciate_ligament", 31, ligament_colour, kLigament, acl},
      {"posterior_cruciate_ligament", 32, ligament_colour, kLigament, pcl},
      {"fibular_collateral_ligament", 33, ligament_colour, kLigament, fcl},
      {"tibial_collateral_ligament", 34, ligament_colour, kLigament, tcl},
      {"patellar_ligament", 35, ligament_colour, kLigament, patellar_ligament},
      {"lateral_meniscus", 81, meniscus_colour, kMeniscus, lateral_meniscus},
      {"medial_meniscus", 82, meniscus_colour, kMeniscus, medial_meniscus},
      {"femoral_cartilage", 83, cartilage_colour, kCartilage, femoral},
      {"lateral_tibial_cartilage", 84, cartilage_colour, kCartilage, lateral_tibial},
      {"medial_tibial_cartilage", 85, cartilage_colour, kCartilage, medial_tibial},
      {"patellar_cartilage", 86, cartilage_colour, kCartilage, patellar},
      {"femur", 95, bone_colour, kBone, femur_bone},
      {"tibia", 96, bone_colour, kBone, tibia_bone},
      {"fibula", 97, bone_colour, kBone, fibula_bone},
      {"patella", 98, bone_colour, kBone, patella_bone},
  };
  parts.insert(parts.end(), joint.begin(), joint.end());
  return parts;
}

KneeShape knee_shape(std::uint64_t seed) {
  PhantomVariation chance(seed);
  KneeShape knee;
  for (int axis = 0; axis < 3; ++axis) knee.stretch[axis] = chance.factor(0.06);
  knee.medial_condyle = chance.factor(0.04);
  knee.lateral_condyle = chance.factor(0.04);
  knee.femoral_cartilage_mm = chance.within(1.6, 2.3, knee.femoral_cartilage_mm);
  knee.tibial_cartilage_mm = chance.within(2.0, 3.0, knee.tibial_cartilage_mm);
  knee.patellar_cartilage_mm = chance.within(2.2, 3.5, knee.patellar_cartilage_mm);
  knee.joint_gap_mm = chance.within(0.6, 0.9, knee.joint_gap_mm);
  knee.patella = chance.factor(0.06);
  knee.patella_up_mm = chance.offset(3);
  knee.meniscus = chance.factor(0.12);
  knee.ligament = chance.factor(0.12);
  for (int axis = 0; axis < 3; ++axis) knee.fibula_mm[axis] = chance.offset(1.5);
  return knee;
}

namespace {

/// Ray that defines a site.
struct SiteView {
  const char* structure;
  P eye, target;
};

// rays, for each structure in the order of its sites
const std::vector<SiteView>& site_views() {
  static const std::vector<SiteView> kViews = {
      {"femur", {90, -6, 44}, {10, -6, 44}},                         // lateral metaphysis
      {"tibia", {-30, -90, -30}, {-18, 1, -30}},                     // anteromedial face
      {"fibula", {90, 19, -34}, {36, 19, -34}},                      // below the head
      {"patella", {1, -90, 36}, {1, -41, 36}},                       // front
      {"femoral_cartilage", {-22, -60, -6}, {-22, -3, 24.5}},        // medial, in front of the meniscus
      {"lateral_tibial_cartilage", {21.5, 2, 50}, {21.5, 2, -2.5}},  // middle of the plateau
      {"medial_tibial_cartilage", {-21, 2, 50}, {-21, 2, -2.5}},     //
      {"patellar_cartilage", {1, 0, 36}, {1, -41, 36}},              // ridge
      {"lateral_meniscus", {90, 1, 2}, {21, 1, 2}},                  // rim
      {"medial_meniscus", {-90, 2, 2}, {-20.5, 2, 2}},               //
      {"anterior_cruciate_ligament", {1, -40, 5}, {1, -2, 5}},       //
      {"posterior_cruciate_ligament", {-2, 60, 0}, {-2, 21, 0}},     //
      {"fibular_collateral_ligament", {90, 10, 12}, {43, 10, 12}},   //
      {"tibial_collateral_ligament", {-90, 2, 16}, {-42.5, 2, 16}},  //
      {"patellar_ligament", {1.5, -90, -3}, {1.5, -41, -3}},         //
      // three more sites of each cartilage
      {"femoral_cartilage", {22, -60, -6}, {22, -3, 24.5}},            // lateral, in front of the meniscus
      {"femoral_cartilage", {-22, -60, 12}, {-22, -3, 24.5}},          // medial, higher
      {"femoral_cartilage", {22, -60, 12}, {22, -3, 24.5}},            // lateral, higher
      {"lateral_tibial_cartilage", {21.5, -5, 50}, {21.5, -5, -2.5}},  // in front of the middle
      {"lateral_tibial_cartilage", {21.5, 9, 50}, {21.5, 9, -2.5}},    // behind the middle
      {"lateral_tibial_cartilage", {15.5, 2, 50}, {15.5, 2, -2.5}},    // towards the spine
      {"medial_tibial_cartilage", {-21, -6, 50}, {-21, -6, -2.5}},     // in front of the middle
      {"medial_tibial_cartilage", {-21, 10, 50}, {-21, 10, -2.5}},     // behind the middle
      {"medial_tibial_cartilage", {-15.5, 2, 50}, {-15.5, 2, -2.5}},   // towards the spine
      {"patellar_cartilage", {-9, 0, 36}, {-9, -41, 36}},              // medial facet
      {"patellar_cartilage", {11, 0, 36}, {11, -41, 36}},              // lateral facet
      {"patellar_cartilage", {1, 0, 29}, {1, -41, 29}},                // lower part of the ridge
  };
  return kViews;
}

}  // namespace

std::size_t knee_site_count(const std::string& structure) {
  return static_cast<std::size_t>(
      std::ranges::count_if(site_views(), [&](const SiteView& view) { return view.structure == structure; }));
}

KneeSite knee_site(const std::string& structure, const Shape& shape, std::size_t index) {
  const auto view = std::ranges::find_if(
      site_views(), [&](const SiteView& v) { return v.structure == structure && index-- == 0; });
  PALPATE_CHECK(view != site_views().end());
  // sphere tracing: no step exceeds the free distance
  const V step = (view->target - view->eye).normalized();
  double distance = 0, free = 1;
  while (free > 1e-6 && distance < 200) {
    free = shape.distance_mm(view->eye + distance * step);
    distance += free;
  }
  PALPATE_CHECK(distance < 200);
  const P point = view->eye + distance * step;
  return {point, shape.normal(point)};
}

}  // namespace palpate
