#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>

#include "palpate/scene/new_scene.h"
#include "palpate/scene/scene.h"
#include "palpate/scene/tissue_presets.h"
#include "palpate/surfaces/ramps.h"
#include "scene/keys.h"

namespace palpate {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

namespace fs = std::filesystem;

constexpr const char* kKnee = R"(title = "A knee"
side = "left"
modality = "mr"
[data]
scan = "scan.nii.gz"
labels = "/data/labels.nrrd"
names = "names.ctbl"
[[tissue]]
name = "bone"
preset = "bone"
labels = ["femur", 96]
[[tissue]]
name = "cartilage"
preset = "cartilage"
labels = ["femoral_cartilage"]
optional = true
stiffness = 0.5
friction = 0.02
friction_damping = 0.004
friction_max = 0.3
static_friction = 0.05
puncture = 4
after_puncture = "stays_open"
youngs_modulus = 500
poissons_ratio = 0.2
viscosity = 0.002
colour = "#0aF1b2"
opacity = 0.25
touchable = true
rests_on = ["bone"]
[[tissue]]
name = "bright"
threshold = [-150.5, 400]
touchable = false
[preparation]
sigma = 0.75
engine = "fourier"
bits = 8
[force]
method = "stored-normals"
sphere_sigma = 1.5
normals = "octahedral24"
coupling_damping = 0.004
[tool]
name = "probe"
points = [[0, 0, 0], [1, 0.5, -2]]
radius = 1.5
[workspace]
scale = 2
force_gain = 0.25
yaw = -90
home = [10, -20.5, 30]
clutch_button = 1
[limits]
max_force = 2.5
)";

TEST(ParseScene, ReadsEveryKey) {
  const auto parsed = parse_scene(kKnee, "scene.toml");
  ASSERT_TRUE(parsed.ok()) << parsed.error().message();
  const Scene& scene = *parsed;
  EXPECT_EQ(scene.title, "A knee");
  EXPECT_EQ(scene.side, Side::kLeft);
  EXPECT_EQ(scene.modality, Modality::kMr);
  EXPECT_EQ(scene.scan, "scan.nii.gz");
  EXPECT_EQ(scene.labels, "/data/labels.nrrd");
  EXPECT_EQ(scene.names, "names.ctbl");
  EXPECT_EQ(scene.source, "scene.toml");
  ASSERT_EQ(scene.tissues.size(), 3u);

  const TissueSettings& bone = scene.tissues[0];
  EXPECT_EQ(bone.preset, "bone");
  EXPECT_EQ(bone.line, 8);
  EXPECT_THAT(bone.labels, ElementsAre(LabelReference("femur"), LabelReference(96)));
  EXPECT_EQ(bone.stiffness_N_per_mm, tissue_presets()[0].values.stiffness_N_per_mm);
  EXPECT_FALSE(bone.optional);
  EXPECT_EQ(bone.colour, tissue_presets()[0].values.colour);

  const TissueSettings& cartilage = scene.tissues[1];
  EXPECT_TRUE(cartilage.optional);
  EXPECT_EQ(cartilage.stiffness_N_per_mm, 0.5);
  EXPECT_EQ(cartilage.friction, 0.02);
  EXPECT_EQ(cartilage.static_friction, 0.05);
  EXPECT_EQ(cartilage.puncture_N, 4);
  EXPECT_TRUE(cartilage.stays_open);
  EXPECT_EQ(cartilage.elastic, (ElasticConstants{500, 0.2}));
  EXPECT_FALSE(bone.elastic.has_value());
  EXPECT_EQ(cartilage.friction_damping_N_s_per_mm, 0.004);
  EXPECT_EQ(cartilage.friction_max_N, 0.3);
  EXPECT_EQ(cartilage.viscosity_N_s_per_mm, 0.002);
  EXPECT_EQ(cartilage.colour, (Rgb{0x0a, 0xf1, 0xb2}));
  EXPECT_EQ(cartilage.opacity, 0.25);
  EXPECT_THAT(cartilage.rests_on, ElementsAre("bone"));

  EXPECT_THAT(*scene.tissues[2].threshold, ElementsAre(-150.5, 400));
  EXPECT_FALSE(scene.tissues[2].touchable);
  EXPECT_EQ(scene.preparation.sigma_mm, 0.75);
  EXPECT_EQ(scene.preparation.engine, GaussianEngine::kFourier);
  EXPECT_EQ(scene.preparation.storage, FieldStorage::k8Bit);
  EXPECT_EQ(scene.force.method, ForceMethod::kStoredNormals);
  EXPECT_EQ(scene.force.settings.sphere_sigma_voxels, 1.5);
  EXPECT_EQ(scene.force.settings.normals, NormalEncoding::kOctahedral24);
  EXPECT_EQ(scene.force.settings.coupling_damping_N_s_per_mm, 0.004);
  EXPECT_EQ(scene.tools[0].name, "probe");
  EXPECT_EQ(scene.tools[0].radius_mm, 1.5);
  ASSERT_EQ(scene.tools[0].points_mm.size(), 2u);
  EXPECT_EQ(scene.tools[0].points_mm[1], Eigen::Vector3d(1, 0.5, -2));
  EXPECT_EQ(scene.workspace.scale, 2);
  EXPECT_EQ(scene.workspace.force_gain, 0.25);
  EXPECT_EQ(scene.workspace.yaw_deg, -90);
  EXPECT_EQ(scene.workspace.home, Point<World>(10, -20.5, 30));
  EXPECT_EQ(scene.workspace.clutch_button, 1);
  EXPECT_EQ(scene.max_force_N, 2.5);
}

double default_of(const TableSpec& table, std::string_view key) {
  return std::stod(std::string(table.find(key)->default_text));
}

TEST(ParseScene, NoGoRegionsAreStructuresPlanesAndBalls) {
  const auto scene = parse_scene(
      "[[tissue]]\nname = 'a'\nlabels = [1]\n[distances]\nstructures = 'all'\nreach = 30\n"
      "[[no_go]]\nname = 'nerve'\nstructures = ['facial nerve', 4]\n"
      "[[no_go]]\nname = 'deep'\npoint = [1, 2, 3]\noutward = 'anterior'\nkeep_away = 0\nstiffness = 0.5\n"
      "[[no_go]]\nname = 'ball'\ncentre = [0, -4, 0]\nradius = 2.5\n"
      "[[no_go]]\nname = 'slant'\npoint = [0, 0, 0]\noutward = [3, 0, 4]\n",
      "t");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  EXPECT_EQ(scene->distances.structures, ReportedStructures::kAll);
  EXPECT_EQ(scene->distances.reach_mm, 30);
  ASSERT_EQ(scene->no_go.size(), 4u);
  EXPECT_EQ(scene->no_go[0].structures, (std::vector<LabelReference>{"facial nerve", 4}));
  EXPECT_EQ(scene->no_go[0].keep_away_mm, 1);
  EXPECT_EQ(scene->no_go[0].stiffness_N_per_mm, 2);
  const auto& plane = std::get<NoGoPlane>(scene->no_go[1].shape);
  EXPECT_EQ(plane.point, Point<Patient>(1, 2, 3));
  EXPECT_EQ(plane.outward, Vector<Patient>(0, -1, 0));
  EXPECT_EQ(scene->no_go[1].keep_away_mm, 0);
  EXPECT_EQ(scene->no_go[1].stiffness_N_per_mm, 0.5);
  EXPECT_EQ(std::get<NoGoSphere>(scene->no_go[2].shape).radius_mm, 2.5);
  EXPECT_EQ(std::get<NoGoPlane>(scene->no_go[3].shape).outward, Vector<Patient>(0.6, 0, 0.8));
}

TEST(ParseScene, AWidthBelongsToRamps) {
  const std::string tissue = "[[tissue]]\nname = 'a'\nlabels = [1]\n[preparation]\n";
  const auto ramps = parse_scene(tissue + "method = 'inward-ramp'\nramp_width = 2.5\n", "t");
  ASSERT_TRUE(ramps.ok()) << ramps.error().message();
  EXPECT_EQ(ramps->preparation.ramp_width_mm, 2.5);
  const auto founding = parse_scene(tissue + "method = 'union-gaussian'\n", "t");
  ASSERT_TRUE(founding.ok()) << founding.error().message();
  EXPECT_EQ(founding->preparation.method, PreparationMethod::kUnionGaussian);
  const auto both = parse_scene(tissue + "method = 'union-gaussian'\nramp_width = 2.5\n", "t");
  ASSERT_FALSE(both.ok());
  EXPECT_EQ(both.error().where, "t:6");
  EXPECT_FALSE(parse_scene(tissue + "ramp_width = 0.5\n", "t").ok());
}

// the documented default is the value of an absent key
TEST(ParseScene, DefaultsAreTheDocumentedOnes) {
  const auto scene = parse_scene("[[tissue]]\nname = 'a'\nlabels = [1]\n", "t");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  const SceneKeys& keys = scene_key_tables();
  const TissueSettings& tissue = scene->tissues[0];
  EXPECT_EQ(tissue.stiffness_N_per_mm, default_of(keys.tissue, "stiffness"));
  EXPECT_EQ(tissue.friction, default_of(keys.tissue, "friction"));
  EXPECT_EQ(tissue.friction_damping_N_s_per_mm, default_of(keys.tissue, "friction_damping"));
  EXPECT_EQ(tissue.friction_max_N, default_of(keys.tissue, "friction_max"));
  EXPECT_EQ(tissue.viscosity_N_s_per_mm, default_of(keys.tissue, "viscosity"));
  EXPECT_EQ(tissue.opacity, default_of(keys.tissue, "opacity"));
  EXPECT_EQ(keys.tissue.find("touchable")->default_text, tissue.touchable ? "true" : "false");
  EXPECT_EQ(keys.tissue.find("optional")->default_text, tissue.optional ? "true" : "false");
  EXPECT_TRUE(tissue.rests_on.empty());
  EXPECT_EQ(scene->preparation.method, PreparationMethod::kInwardRamp);
  EXPECT_EQ(keys.preparation.find("method")->default_text, "\"inward-ramp\"");
  EXPECT_FALSE(scene->preparation.ramp_width_mm);
  EXPECT_EQ(kUsualRampWidth_mm, default_of(keys.preparation, "ramp_width"));
  EXPECT_EQ(scene->preparation.sigma_mm, default_of(keys.preparation, "sigma"));
  EXPECT_EQ(scene->preparation.engine, GaussianEngine::kDirect);
  EXPECT_EQ(keys.preparation.find("engine")->default_text, "\"direct\"");
  EXPECT_EQ(scene->preparation.storage, FieldStorage::k16Bit);
  EXPECT_EQ(default_of(keys.preparation, "bits"), 16);
  EXPECT_EQ(keys.force.find("method")->default_text, "\"" + std::string(name_of(scene->force.method)) + "\"");
  EXPECT_EQ(scene->force.settings.sphere_sigma_voxels, default_of(keys.force, "sphere_sigma"));
  EXPECT_EQ(scene->force.settings.normals, NormalEncoding::kBytes);
  EXPECT_EQ(keys.force.find("normals")->default_text, "\"bytes\"");
  EXPECT_EQ(scene->force.settings.coupling_damping_N_s_per_mm, default_of(keys.force, "coupling_damping"));
  EXPECT_FALSE(tissue.elastic.has_value()) << "it is rigid";
  EXPECT_EQ(ElasticConstants().poissons_ratio, default_of(keys.tissue, "poissons_ratio"));
  EXPECT_EQ(scene->deformation.law, TissueLaw::kLayers);
  EXPECT_EQ(keys.deformation.find("law")->default_text, "\"layers\"");
  EXPECT_FALSE(scene->deformation.cell_mm);
  EXPECT_EQ(keys.tool.find("name")->default_text, "\"" + scene->tools[0].name + "\"");
  ASSERT_EQ(scene->tools[0].points_mm.size(), 1u);
  EXPECT_EQ(scene->tools[0].points_mm[0], Eigen::Vector3d::Zero());
  EXPECT_EQ(keys.tool.find("points")->default_text, "[[0, 0, 0]]");
  EXPECT_EQ(scene->workspace.scale, default_of(keys.workspace, "scale"));
  EXPECT_EQ(scene->workspace.force_gain, default_of(keys.workspace, "force_gain"));
  EXPECT_EQ(scene->workspace.yaw_deg, default_of(keys.workspace, "yaw"));
  EXPECT_EQ(keys.workspace.find("home")->default_text, "[0, 0, 0]");
  EXPECT_FALSE(scene->workspace.home.has_value()) << "empty: World's origin";
  EXPECT_EQ(scene->workspace.clutch_button, -1);
  EXPECT_TRUE(keys.workspace.find("clutch_button")->default_text.empty());
  EXPECT_EQ(scene->side, Side::kUnknown);
  EXPECT_FALSE(scene->max_force_N.has_value());
}

ElasticConstants elastic_of(const std::string& keys) {
  const auto scene = parse_scene("[[tissue]]\nname = 'a'\nlabels = [1]\n" + keys, "t");
  EXPECT_TRUE(scene.ok()) << (scene.ok() ? "" : scene.error().message());
  if (!scene.ok() || !scene->tissues[0].elastic) return {-1, -1};
  return *scene->tissues[0].elastic;
}

TEST(ParseScene, TissueCombinesKeysAndPreset) {
  const ElasticConstants muscle = elastic_of("preset = 'muscle'\n");
  EXPECT_EQ(muscle, (ElasticConstants{14, 0.45}));
  EXPECT_EQ(elastic_of("youngs_modulus = 20\n"), (ElasticConstants{20, 0.45}));
  EXPECT_EQ(elastic_of("preset = 'meniscus'\nyoungs_modulus = 20\n"), (ElasticConstants{20, 0}));
  EXPECT_EQ(elastic_of("preset = 'muscle'\npoissons_ratio = 0.3\n"), (ElasticConstants{14, 0.3}));
  EXPECT_EQ(elastic_of("preset = 'bone'\nyoungs_modulus = 1e5\npoissons_ratio = 0.495\n"),
            (ElasticConstants{100'000, 0.495}));
  EXPECT_EQ(elastic_of("youngs_modulus = 0.1\npoissons_ratio = 0\n"), (ElasticConstants{0.1, 0}));
  EXPECT_EQ(elastic_of("preset = 'liver'\n").stiffening, find_preset("liver")->values.elastic->stiffening);
  EXPECT_EQ(elastic_of("preset = 'liver'\nstiffening = 0\n").stiffening, 0);
  EXPECT_EQ(elastic_of("youngs_modulus = 20\nstiffening = 100\n"), (ElasticConstants{20, 0.45, 100}));
  const auto scene = parse_scene(
      "[[tissue]]\nname = 'a'\nlabels = [1]\npreset = 'liver'\n[yielding]\nlaw = 'exponential'\n"
      "relaxation = true\ncell = 1\n",
      "t");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  EXPECT_EQ(scene->deformation.law, TissueLaw::kExponential);
}

Relaxation relaxation_of(const std::string& keys, const std::string& yielding = "") {
  const auto scene = parse_scene(
      "[[tissue]]\nname = 'a'\nlabels = [1]\n" + keys + "[yielding]\nlaw = 'elastic'\n" + yielding, "t");
  EXPECT_TRUE(scene.ok()) << (scene.ok() ? "" : scene.error().message());
  return scene.ok() ? scene->tissues[0].relaxation : Relaxation{{{{-1, 0}, {}}}};
}

TEST(ParseScene, RelaxationComesFromKeysOrPreset) {
  const Relaxation none;
  const Relaxation muscle{{{{0.15, 0.7}, {}}}};
  const std::string requested = "relaxation = true\n";
  EXPECT_EQ(relaxation_of("youngs_modulus = 10\n"), none);
  EXPECT_EQ(relaxation_of("youngs_modulus = 10\n", requested), none) << "it has no preset";
  EXPECT_EQ(relaxation_of("preset = 'muscle'\n"), none) << "scenes of before";
  EXPECT_EQ(relaxation_of("preset = 'muscle'\n", "relaxation = false\n"), none);
  EXPECT_EQ(relaxation_of("preset = 'muscle'\n", requested), muscle);
  EXPECT_EQ(relaxation_of("preset = 'liver'\n", requested), none);
  EXPECT_EQ(relaxation_of("preset = 'muscle'\nrelaxation = []\n", requested), none);
  const Relaxation own{{{{0.3, 0.5}, {0.2, 10}}}};
  EXPECT_EQ(relaxation_of("preset = 'muscle'\nrelaxation = [[0.3, 0.5], [0.2, 10]]\n"), own);
  EXPECT_EQ(relaxation_of("relaxation = [[0.3, 0.5], [0.2, 10]]\nyoungs_modulus = 5\n", requested), own);
  EXPECT_EQ(relaxation_of("youngs_modulus = 10\nrelaxation = [[0.999, 0.01]]\n").term[0].time_s, 0.01);
}

TEST(ParseScene, DeformationFollowsTheLaw) {
  const auto scene =
      parse_scene("[[tissue]]\nname = 'a'\nlabels = [1]\n[yielding]\nlaw = 'elastic'\ncell = 1.25\n", "t");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  EXPECT_EQ(scene->deformation.law, TissueLaw::kElastic);
  EXPECT_EQ(scene->deformation.cell_mm, 1.25);
}

TEST(ParseScene, AToolHasCapsules) {
  const auto scene = parse_scene(
      "[[tissue]]\nname = 'a'\nlabels = [1]\n[tool]\nradius = 0.5\n"
      "[[tool.capsule]]\nfrom = [0, 0, 0]\nto = [0, 0, 120.5]\nradius = 2\n"
      "[[tool.capsule]]\nfrom = [0, 0, 0]\nto = [3, 0, 0]\n",
      "t");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  EXPECT_EQ(scene->tools[0].points_mm.size(), 1u) << "the tip";
  ASSERT_EQ(scene->tools[0].capsules.size(), 2u);
  EXPECT_EQ(scene->tools[0].capsules[0].to_mm, Eigen::Vector3d(0, 0, 120.5));
  EXPECT_EQ(scene->tools[0].capsules[0].radius_mm, 2);
  EXPECT_EQ(scene->tools[0].capsules[1].to_mm, Eigen::Vector3d(3, 0, 0));
  EXPECT_EQ(scene->tools[0].capsules[1].radius_mm, 0.5) << "the tool's";
}

TEST(ParseScene, WorkspaceTakesItsWholeRange) {
  for (const auto& [number, button] : {std::pair{"0.05", "0"}, {"20", "31"}}) {
    const auto scene =
        parse_scene(std::string("[[tissue]]\nname = 'a'\nlabels = [1]\n[workspace]\nscale = ") + number +
                        "\nforce_gain = " + number + "\nclutch_button = " + button,
                    "t");
    ASSERT_TRUE(scene.ok()) << scene.error().message();
    EXPECT_EQ(scene->workspace.scale, std::stod(number));
    EXPECT_EQ(scene->workspace.force_gain, std::stod(number));
    EXPECT_EQ(scene->workspace.clutch_button, std::stoi(button));
  }
}

TEST(ParseScene, WithoutDataTheVolumesComeFromTheCaller) {
  const auto scene =
      parse_scene("[[tissue]]\nname = 'a'\nlabels = [1]\n[[tissue]]\nname = 'b'\nthreshold = [1, 2]\n", "t");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  EXPECT_FALSE(scene->labels.has_value());
  EXPECT_FALSE(scene->scan.has_value());
}

TEST(ParseScene, EnergiesFollowDensityOnlyInAScanThatIsSaidToBeCalibrated) {
  const std::string scene =
      "[data]\nscan = 'ct.nrrd'\nlabels = 'a.nrrd'\n[[tissue]]\nname = 'a'\nlabels = [1]\n";
  const auto full_HU = [&](const std::string& more) {
    return parse_scene(scene + more, "scene.toml")->full_density_HU;
  };
  EXPECT_EQ(full_HU(""), std::nullopt);
  EXPECT_EQ(full_HU("[density]\ncalibrated = false\n"), std::nullopt);
  EXPECT_EQ(full_HU("[density]\ncalibrated = true\n"), 1700);
  EXPECT_EQ(full_HU("[density]\ncalibrated = true\nfull = 1400\n"), 1400);
}

TEST(ParseScene, ABurrIsABallWithAMotor) {
  const auto scene = parse_scene(
      "[data]\nlabels = 'a.nrrd'\n[[tissue]]\nname = 'a'\nlabels = [1]\ncutting_energy = 60\nprotection = "
      "'keep'\n"
      "[tool]\nkind = 'burr'\ndiameter = 3\nspeed = 30000\nspindle = [0, 0.5, 0]\ngrip = 0.4\npedal = 1\n",
      "scene.toml");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  EXPECT_EQ(scene->tissues[0].cutting_energy_mJ_per_mm3, 60);
  EXPECT_EQ(scene->tissues[0].protection, Protection::kBlock);
  EXPECT_EQ(scene->tools[0].radius_mm, 1.5);
  ASSERT_EQ(scene->tools[0].points_mm.size(), 1u);
  ASSERT_TRUE(scene->tools[0].burr);
  EXPECT_EQ(scene->tools[0].burr->revolutions_per_s, 500);
  EXPECT_EQ(scene->tools[0].burr->spindle, Eigen::Vector3d(0, 1, 0));
  EXPECT_EQ(scene->tools[0].burr->grip, 0.4);
  EXPECT_EQ(scene->tools[0].burr->pedal, 1);
}

TEST(ParseScene, ABurrMayBeACylinderOrACone) {
  const auto tool_of = [](const std::string& keys) {
    const auto scene = parse_scene(
        "[data]\nlabels = 'a.nrrd'\n[[tissue]]\nname = 'a'\nlabels = [1]\n[tool]\nkind = 'burr'\n" + keys,
        "t");
    EXPECT_TRUE(scene.ok()) << scene.error().message();
    return scene.ok() ? scene->tools[0] : Tool{};
  };
  const Tool cylinder = tool_of("shape = 'cylinder'\ndiameter = 3\nlength = 8\n");
  EXPECT_EQ(cylinder.radius_mm, 1.5);
  EXPECT_EQ(cylinder.burr->length_mm, 5);
  EXPECT_EQ(cylinder.burr->end_radius_mm, 1.5);
  EXPECT_EQ(burr_description(cylinder), "burr: a cylinder of 3 mm, 8 mm long");
  const Tool cone = tool_of("shape = 'cone'\ndiameter = 3\nlength = 8\ntip_diameter = 1.5\n");
  EXPECT_EQ(cone.radius_mm, 0.75);
  EXPECT_EQ(cone.burr->length_mm, 8 - 0.75 - 1.5);
  EXPECT_EQ(cone.burr->end_radius_mm, 1.5);
  EXPECT_EQ(burr_description(cone), "burr: a cone of 3 mm, 1.5 mm at its tip, 8 mm long");
  // a cone that is wider at its tip
  EXPECT_EQ(burr_shape(tool_of("shape = 'cone'\ndiameter = 2\nlength = 5\ntip_diameter = 4\n")), "cone");
  const Tool ball = tool_of("shape = 'ball'\ndiameter = 3\n");
  EXPECT_EQ(ball.burr->length_mm, 0);
  EXPECT_EQ(burr_description(ball), "burr: a ball of 3 mm");
  EXPECT_EQ(burr_shape(Tool{}), "");
}

TEST(Scene, ShaverCutsSoftTissueOnly) {
  const std::string tissues =
      "[data]\nlabels = 'a.nrrd'\n[[tissue]]\nname = 'meniscus'\nlabels = [1]\nyoungs_modulus = 100\n"
      "[[tissue]]\nname = 'bone'\nlabels = [2]\n"
      "[[tissue]]\nname = 'spur'\nlabels = [3]\ncutting_energy = 80\n"
      "[[tissue]]\nname = 'plate'\nlabels = [4]\nprotection = 'none'\n"
      "[[tissue]]\nname = 'shown'\nlabels = [5]\ntouchable = false\n";
  const auto scene = parse_scene(tissues + "[tool]\nkind = 'shaver'\n", "t");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  const Tool& shaver = scene->tools[0];
  ASSERT_TRUE(shaver.burr);
  EXPECT_EQ(shaver.name, "shaver");
  EXPECT_EQ(shaver.radius_mm, 2.75);
  EXPECT_EQ(burr_description(shaver), "shaver: a ball of 5.5 mm");
  EXPECT_NEAR(60 * shaver.burr->revolutions_per_s, 2500, 1e-9);
  const auto& tissue = scene->tissues;
  EXPECT_EQ(tissue[0].protection, Protection::kNone);
  EXPECT_EQ(tissue[0].cutting_energy_mJ_per_mm3, 5);
  EXPECT_EQ(tissue[1].protection, Protection::kBlock);
  EXPECT_EQ(tissue[2].protection, Protection::kNone);
  EXPECT_EQ(tissue[2].cutting_energy_mJ_per_mm3, 80);
  EXPECT_EQ(tissue[3].protection, Protection::kNone);
  EXPECT_EQ(tissue[4].protection, Protection::kNone);
  // a scene with a burr is unaffected
  const auto burr = parse_scene(tissues + "[tool]\nkind = 'burr'\n", "t");
  ASSERT_TRUE(burr.ok()) << burr.error().message();
  EXPECT_EQ(burr->tissues[0].cutting_energy_mJ_per_mm3, 100);
  EXPECT_EQ(burr->tissues[1].protection, Protection::kNone);
  EXPECT_EQ(burr->tools[0].radius_mm, 2);

  // both tools: the scene has to set protection
  const std::string both =
      "[tool]\nkind = 'shaver'\nshape = 'cylinder'\ndiameter = 4\nlength = 9\n"
      "[second_tool]\nkind = 'burr'\n";
  const auto unsaid = parse_scene(tissues + both, "t");
  ASSERT_FALSE(unsaid.ok());
  EXPECT_THAT(unsaid.error().message(), HasSubstr("tissue \"bone\" cannot be cut by a shaver"));
  const auto cone =
      parse_scene(tissues + "[tool]\nkind = 'shaver'\nshape = 'cone'\nlength = 9\ntip_diameter = 2\n", "t");
  ASSERT_FALSE(cone.ok());
  EXPECT_THAT(cone.error().message(), HasSubstr("a shaver cannot be a cone"));
}

TEST(ParseScene, BurrDefaultsMatchTheKeyTable) {
  const auto scene =
      parse_scene("[data]\nlabels = 'a.nrrd'\n[[tissue]]\nname = 'a'\nlabels = [1]\n[tool]\nkind = 'burr'\n",
                  "scene.toml");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  const TableSpec& tool = scene_key_tables().tool;
  const auto default_of = [&](const char* key) {
    return std::stod(std::string(tool.find(key)->default_text));
  };
  EXPECT_EQ(2 * scene->tools[0].radius_mm, default_of("diameter"));
  EXPECT_EQ(60 * scene->tools[0].burr->revolutions_per_s, default_of("speed"));
  EXPECT_EQ(scene->tools[0].burr->grip, default_of("grip"));
  EXPECT_EQ(scene->tools[0].burr->spindle, Eigen::Vector3d(0, 0, 1));
  EXPECT_EQ(scene->tools[0].burr->pedal, -1);
  EXPECT_EQ(scene->tissues[0].cutting_energy_mJ_per_mm3,
            std::stod(std::string(scene_key_tables().tissue.find("cutting_energy")->default_text)));
}

constexpr const char* kSceneOfTwoTools =
    "[[tissue]]\nname = 'a'\nlabels = [1]\n"
    "[tool]\nkind = 'burr'\nname = 'drill'\ndiameter = 3\npedal = 1\n"
    "[second_tool]\nname = 'hook'\nradius = 1.5\n[[second_tool.capsule]]\nfrom = [0, 0, 0]\nto = [0, 0, "
    "40]\n";

TEST(ParseScene, TheSecondDeviceMayHoldAToolOfItsOwn) {
  const auto scene = parse_scene(kSceneOfTwoTools, "t");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  ASSERT_EQ(scene->tools.size(), 2u);
  EXPECT_EQ(scene->tools[0].name, "drill");
  EXPECT_EQ(scene->tools[0].burr->pedal, 1);
  EXPECT_EQ(scene->tools[1].name, "hook");
  EXPECT_EQ(scene->tools[1].radius_mm, 1.5);
  EXPECT_FALSE(scene->tools[1].burr);
  ASSERT_EQ(scene->tools[1].capsules.size(), 1u);
  EXPECT_EQ(scene->tools[1].capsules[0].radius_mm, 1.5) << "its own tool's";
  // the defaults of [tool], not the values given there
  const auto plain = parse_scene(
      "[[tissue]]\nname = 'a'\nlabels = [1]\n[second_tool]\n[tool]\nname = 'ball'\nradius = 2\n", "t");
  ASSERT_TRUE(plain.ok()) << plain.error().message();
  ASSERT_EQ(plain->tools.size(), 2u);
  EXPECT_EQ(plain->tools[0].radius_mm, 2);
  EXPECT_EQ(plain->tools[1].name, "point");
  EXPECT_EQ(plain->tools[1].radius_mm, 0);
  // a burr requires the proxy, in either device
  const auto burrs =
      parse_scene("[[tissue]]\nname = 'a'\nlabels = [1]\n[second_tool]\nkind = 'burr'\ndiameter = 2\n", "t");
  ASSERT_TRUE(burrs.ok()) << burrs.error().message();
  EXPECT_FALSE(burrs->tools[0].burr);
  EXPECT_EQ(burrs->tools[1].radius_mm, 1);
}

TEST(ParseScene, ErrorsOfTheSecondToolNameItsTable) {
  const auto fault = [](const std::string& keys) {
    const auto scene = parse_scene("[[tissue]]\nname = 'a'\nlabels = [1]\n[second_tool]\n" + keys, "t");
    return scene.ok() ? std::string("nothing") : scene.error().message();
  };
  EXPECT_THAT(fault("radius = 13\n"), HasSubstr("t:5: [second_tool]: radius = 13 is outside 0 ... 12 mm"));
  EXPECT_THAT(fault("diamter = 9\n"), HasSubstr("t:5: unknown key \"diamter\" in [second_tool]"));
  EXPECT_THAT(fault("diameter = 3\n"), HasSubstr("t:5: [second_tool]: `diameter` is a key of burrs"));
  EXPECT_THAT(fault("kind = 'burr'\nshape = 'cone'\n"),
              HasSubstr("t:6: [second_tool]: a cone without `length`"));
  EXPECT_THAT(fault("kind = 'burr'\n[force]\nmethod = 'trilinear'\n"),
              HasSubstr("t:5: [second_tool]: a burr requires the proxy"));
  EXPECT_THAT(fault("points = []\n"), HasSubstr("t:5: [second_tool]: "));
  EXPECT_THAT(fault("name = 3\n"), HasSubstr("t:5: [second_tool]: "));
  EXPECT_THAT(fault("capsule = 3\n"), HasSubstr("write [[second_tool.capsule]]"));
  EXPECT_THAT(fault("[[second_tool.capsule]]\nfrom = [0, 0, 0]\n"),
              HasSubstr("t:5: [second_tool]: a capsule without `to`"));
  EXPECT_THAT(fault("[[second_tool.capsule]]\nform = [0, 0, 0]\n"), HasSubstr("[[second_tool.capsule]]"));
  EXPECT_THAT(fault("second_tool = 3\n"), HasSubstr("unknown key \"second_tool\" in [second_tool]"));
  // the first of two errors is reported
  EXPECT_THAT(fault("radius = 14\n[tool]\nradius = 13\n"), HasSubstr("radius = 14"));
  const auto twice = parse_scene("[[tissue]]\nname = 'a'\nlabels = [1]\n[[second_tool]]\nradius = 1\n", "t");
  ASSERT_FALSE(twice.ok());
  EXPECT_THAT(twice.error().message(), HasSubstr("second_tool"));
}

struct BadScene {
  const char* text;
  int line;
  const char* what;
  const char* remedy;
};

void PrintTo(const BadScene& bad, std::ostream* out) {
  *out << bad.text;
}

class ParseSceneError : public testing::TestWithParam<BadScene> {};

TEST_P(ParseSceneError, NamesLineReasonAndRemedy) {
  const auto scene = parse_scene(GetParam().text, "scene.toml");
  ASSERT_FALSE(scene.ok());
  EXPECT_EQ(scene.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(scene.error().where, "scene.toml:" + std::to_string(GetParam().line)) << scene.error().message();
  EXPECT_THAT(scene.error().what, HasSubstr(GetParam().what));
  EXPECT_THAT(scene.error().remedy, HasSubstr(GetParam().remedy));
}

#define TISSUE "[[tissue]]\nname = 'a'\nlabels = [1]\n"

INSTANTIATE_TEST_SUITE_P(
    Keys, ParseSceneError,
    testing::Values(
        BadScene{TISSUE "[tool]\nkind = 'burr'\nradius = 2\n", 6, "a burr has no `radius`", "diameter"},
        BadScene{TISSUE "[tool]\nkind = 'burr'\nshape = 'cylinder'\n", 6, "a cylinder without `length`",
                 "add: length = 8"},
        BadScene{TISSUE "[tool]\nkind = 'burr'\nlength = 8\n", 6, "a ball has no `length`",
                 "shape = \"cylinder\""},
        BadScene{TISSUE "[tool]\nkind = 'burr'\nshape = 'cylinder'\ndiameter = 4\nlength = 3\n", 8,
                 "a cylinder of 4 mm that is 3 mm long", "make `length` larger"},
        BadScene{TISSUE "[tool]\nkind = 'burr'\nshape = 'cylinder'\nlength = 8\ntip_diameter = 2\n", 8,
                 "a cylinder has no `tip_diameter`", "shape = \"cone\""},
        BadScene{TISSUE "[tool]\nkind = 'burr'\nshape = 'cone'\nlength = 8\n", 6,
                 "a cone without `tip_diameter`", "add: tip_diameter"},
        BadScene{TISSUE "[tool]\nkind = 'burr'\nshape = 'cone'\nlength = 4\ntip_diameter = 5\ndiameter = 2\n",
                 7, "a cone of 5 mm that is 4 mm long", "make `length` larger"},
        BadScene{TISSUE "[tool]\nkind = 'burr'\nshape = 'cone'\nlength = 8\ntip_diameter = 4\n", 8,
                 "as wide at its tip as at its far end", "shape = \"cylinder\""},
        BadScene{TISSUE "[tool]\nshape = 'cone'\n", 5, "`shape` is a key of burrs", "kind = \"burr\""},
        BadScene{TISSUE "[tool]\ndiameter = 2\n", 5, "`diameter` is a key of burrs", "kind = \"burr\""},
        BadScene{TISSUE "[tool]\nkind = 'burr'\nspindle = [0, 0, 0]\n", 6, "the spindle has no direction",
                 "[0, 0, 1]"},
        BadScene{TISSUE "[tool]\nkind = 'burr'\n[force]\nmethod = 'trilinear'\n", 5, "requires the proxy",
                 "method = \"proxy\""},
        BadScene{TISSUE "[density]\nfull = 1500\n", 5, "not said to be calibrated", "calibrated = true"},
        BadScene{TISSUE "[density]\ncalibrated = true\nfull = 100\n", 6, "outside 200 ... 4000 HU", ""},
        BadScene{"modality = 'mr'\n" TISSUE "[density]\ncalibrated = true\n", 6, "no Hounsfield units",
                 "[density]"},
        BadScene{"[data]\nlabels = 'a.nrrd'\n" TISSUE "[density]\ncalibrated = true\n", 1, "needs a scan",
                 "scan ="},
        BadScene{TISSUE "[tool]\nkind = 'drill'\n", 5, "drill", "\"burr\""},
        BadScene{TISSUE "youngs_modulus = 0.05\n", 4, "youngs_modulus = 0.05 is outside 0.1 ... 100000 kPa",
                 "a number"},
        BadScene{TISSUE "youngs_modulus = 100001\npoissons_ratio = 0.3\n", 4, "outside 0.1 ... 100000 kPa",
                 ""},
        BadScene{TISSUE "youngs_modulus = 10\npoissons_ratio = 0.5\n", 5,
                 "poissons_ratio = 0.5 is outside 0 ... 0.495", "default 0.45"},
        BadScene{TISSUE "youngs_modulus = 10\npoissons_ratio = -0.1\n", 5, "outside 0 ... 0.495", ""},
        BadScene{TISSUE "poissons_ratio = 0.3\n", 4, "tissue \"a\" has a Poisson's ratio but no modulus",
                 "add youngs_modulus = 10"},
        BadScene{TISSUE "stiffening = 5\n", 4, "tissue \"a\" has a stiffening but no modulus",
                 "add youngs_modulus = 10"},
        BadScene{TISSUE "youngs_modulus = 10\nstiffening = 101\n", 5, "stiffening = 101 is outside 0 ... 100",
                 "default 0"},
        BadScene{TISSUE "youngs_modulus_kPa = 10\n", 4, "unknown key \"youngs_modulus_kPa\"",
                 "did you mean youngs_modulus?"},
        BadScene{TISSUE "[yielding]\nlaw = 'jelly'\n", 5, "jelly",
                 "\"elastic\", \"neo-hookean\", \"exponential\", \"chainmail\" or \"layers\""},
        BadScene{TISSUE "[yielding]\nlaw = 'elastic'\ncell = 0.1\n", 6, "cell = 0.1 is outside 0.2 ... 10 mm",
                 "a number"},
        BadScene{TISSUE "[yielding]\nrelaxation = true\n", 5,
                 "relaxation belongs to the laws \"elastic\", \"neo-hookean\" and \"exponential\"",
                 "take it out"},
        BadScene{TISSUE "youngs_modulus = 10\nrelaxation = [[0.6, 1], [0.4, 2]]\n", 5,
                 "tissue \"a\" relaxes by 1 of its modulus", "sum of the fractions must be below 1"},
        BadScene{TISSUE "youngs_modulus = 10\nrelaxation = [[0, 1]]\n", 5, "relaxes by a fraction of 0",
                 "a fraction must be above 0"},
        BadScene{TISSUE "youngs_modulus = 10\nrelaxation = [[-0.1, 1]]\n", 5, "relaxes by a fraction of -0.1",
                 ""},
        BadScene{TISSUE "youngs_modulus = 10\nrelaxation = [[0.1, 0]]\n", 5,
                 "relaxation = 0 is outside 0.01 ... 1000 s", "a list of pairs [fraction, time]"},
        BadScene{TISSUE "youngs_modulus = 10\nrelaxation = [[0.1, 1001]]\n", 5, "outside 0.01 ... 1000 s",
                 ""},
        BadScene{TISSUE "youngs_modulus = 10\nrelaxation = [[0.1, 1], [0.1, 2], [0.1, 3]]\n", 5,
                 "relaxes by 3 terms", "at most 2 pairs"},
        BadScene{TISSUE "youngs_modulus = 10\nrelaxation = [0.1, 1]\n", 5, "not two numbers [fraction, time]",
                 ""},
        BadScene{TISSUE "youngs_modulus = 10\nrelaxation = [[0.1, 1, 2]]\n", 5,
                 "not two numbers [fraction, time]", ""},
        BadScene{TISSUE "youngs_modulus = 10\nrelaxation = [['a', 1]]\n", 5, "relaxation", ""},
        BadScene{TISSUE "youngs_modulus = 10\nrelaxation = 0.5\n", 5, "relaxation is a number",
                 "a list of pairs"},
        BadScene{TISSUE "relaxation = [[0.1, 1]]\n", 4, "tissue \"a\" has a relaxation but no modulus",
                 "add youngs_modulus = 10"},
        BadScene{TISSUE "after_puncture = 'stays_open'\n", 4,
                 "stays open after a puncture, but has no puncture force", "add puncture = 1"},
        BadScene{TISSUE "puncture = 1\nafter_puncture = 'open'\n", 5, "after_puncture", "stays_open"},
        BadScene{TISSUE "[yielding]\ncell = 1\n", 5,
                 "cell belongs to the laws \"elastic\", \"neo-hookean\", \"exponential\" and \"chainmail\"",
                 "take it out"},
        BadScene{TISSUE "[force]\nmethod = 'trilinear'\n[yielding]\nlaw = 'elastic'\n", 7,
                 "yields only with the proxy", "law = \"layers\""},
        BadScene{TISSUE "[yielding]\nlaws = 'elastic'\n", 5, "unknown key \"laws\" in [yielding]",
                 "did you mean law?"},
        BadScene{TISSUE "stifness = 1\n", 4, "unknown key \"stifness\" in [[tissue]]",
                 "did you mean stiffness?"},
        BadScene{"tilte = 'x'\n" TISSUE, 1, "unknown key \"tilte\"", "did you mean title?"},
        BadScene{TISSUE "[preperation]\nsigma = 1\n", 4, "unknown key \"preperation\"",
                 "did you mean preparation?"},
        BadScene{TISSUE "[data]\nlabels = 'l'\nscam = 's'\n", 6, "unknown key \"scam\" in [data]",
                 "did you mean scan?"},
        BadScene{TISSUE "[limits]\nmax_forse = 3\n", 5, "unknown key", "did you mean max_force?"},
        BadScene{TISSUE "[[no_go]]\nstructures = [1]\n", 4, "a no-go region without a name", "add: name"},
        BadScene{TISSUE "[[no_go]]\nname = 'n'\n", 4, "no-go region \"n\" has no geometry",
                 "a region is made of"},
        BadScene{TISSUE "[[no_go]]\nname = 'n'\nstructures = [1]\nradius = 2\n", 4,
                 "is defined in more than one way", "a region is made of"},
        BadScene{TISSUE "[[no_go]]\nname = 'n'\npoint = [0,0,0]\n", 4, "has no `outward`", "superior"},
        BadScene{TISSUE "[[no_go]]\nname = 'n'\ncentre = [0,0,0]\n", 4, "has no `radius`", "add: radius"},
        BadScene{TISSUE "[[no_go]]\nname = 'n'\nstructures = [1]\nkeep_away = 21\n", 7,
                 "keep_away = 21 is outside 0 ... 20 mm", ""},
        BadScene{TISSUE "[[no_go]]\nname = 'n'\nstructures = [1]\nstiffness = 0\n", 7,
                 "stiffness = 0 is outside", ""},
        BadScene{TISSUE "[distances]\nstructures = 'some'\n", 5, "structures", "touchable"},
        BadScene{TISSUE "[distances]\nreach = 51\n", 5, "reach = 51 is outside 1 ... 50 mm", ""},
        BadScene{TISSUE "[tool]\npoint = [[0,0,0]]\n", 5, "unknown key", "did you mean points?"},
        BadScene{TISSUE "[[tool.capsule]]\nform = [0,0,0]\nto = [0,0,1]\n", 5,
                 "unknown key \"form\" in [[tool.capsule]]", "did you mean from?"},
        BadScene{TISSUE "[[tool.capsule]]\nfrom = [0,0,0]\n", 4, "a capsule without `to`",
                 "add: to = [x, y, z]"},
        BadScene{TISSUE "[[tool.capsule]]\nfrom = [0,0,0]\nto = [0,0,0.05]\n", 6,
                 "ends are less than 0.1 mm apart", "move one end"},
        BadScene{TISSUE "[[tool.capsule]]\nfrom = [0,0,0]\nto = [0,0,301]\n", 6, "outside -300 ... 300", ""},
        BadScene{TISSUE "[tool]\ncapsule = 3\n", 5, "capsule is a whole number", "write [[tool.capsule]]"},
        BadScene{TISSUE "[tool]\npoints = [[0,0,0],[1,0,0],[2,0,0]]\ncapsule = [{from=[0,0,0],to=[1,0,0]},"
                        "{from=[0,0,0],to=[0,1,0]}]\n",
                 6, "the tool has 5 points and capsules", "together they may be 4"},
        BadScene{TISSUE "[workspace]\nforce_gian = 2\n", 5, "unknown key \"force_gian\" in [workspace]",
                 "did you mean force_gain?"},
        BadScene{TISSUE "[workpace]\nscale = 2\n", 4, "unknown key \"workpace\"", "did you mean workspace?"},
        BadScene{TISSUE "preset = 'bome'\n", 4, "unknown preset \"bome\"", "did you mean \"bone\"?"},
        BadScene{"side = 'lefft'\n" TISSUE, 1, "unknown side", "did you mean \"left\"?"},
        BadScene{TISSUE "[preparation]\nengine = 'fft'\n", 5, "unknown engine", "\"direct\" or \"fourier\""},
        // without a close candidate only the choices are listed
        BadScene{TISSUE "[preparation]\nengine = 'fft'\n", 5, "unknown engine", "engine takes \"direct\""},
        BadScene{"side = 'up'\n" TISSUE, 1, "unknown side", "side takes \"left\""},
        BadScene{TISSUE "zzzzzz = 1\n", 4, "unknown key \"zzzzzz\"", "the keys here are name, preset"},
        // a mistyped key precedes the key it makes missing
        BadScene{"title = 'x'\n[[tissues]]\nname = 'a'\nlabels = [1]\n", 2, "unknown key \"tissues\"",
                 "did you mean tissue?"},
        BadScene{"[[tissue]]\nnam = 'a'\nlabels = [1]\n", 2, "unknown key \"nam\"", "did you mean name?"},
        BadScene{"[[tissue]]\nname = 'a'\nlables = [1]\n", 3, "unknown key \"lables\"",
                 "did you mean labels?"},
        // the first error by line is reported
        BadScene{TISSUE "opacity = 2\nstifness = 1\n", 4, "opacity = 2 is outside 0 ... 1", ""},
        BadScene{TISSUE "stifness = 1\nopacity = 2\n", 4, "unknown key", ""}));

INSTANTIATE_TEST_SUITE_P(
    Types, ParseSceneError,
    testing::Values(
        BadScene{TISSUE "stiffness = 'hard'\n", 4, "stiffness is a text",
                 "a number, 0.001 ... 20 N/mm; default 1"},
        BadScene{TISSUE "touchable = 1\n", 4, "touchable is a whole number", "true or false"},
        BadScene{TISSUE "colour = [1, 2, 3]\n", 4, "colour is a list", "a colour"},
        BadScene{TISSUE "colour = '#12345g'\n", 4, "not a colour", "#e6e696"},
        BadScene{TISSUE "colour = '#12345'\n", 4, "not a colour", "hexadecimal"},
        BadScene{TISSUE "colour = '1234567'\n", 4, "not a colour", "hexadecimal"},
        BadScene{TISSUE "rests_on = 'b'\n", 4, "rests_on is a text", "a list of names"},
        BadScene{TISSUE "rests_on = [1]\n", 4, "rests_on holds a whole number", "a list of names"},
        BadScene{"title = 3\n" TISSUE, 1, "title is a whole number", "a text"},
        BadScene{"title = ''\n" TISSUE, 1, "title is empty", "give it a text"},
        BadScene{"title = 1979-05-27\n" TISSUE, 1, "title is a date", "a text"},
        BadScene{"side = 2\n" TISSUE, 1, "side is a whole number",
                 "\"left\", \"right\", \"both\" or \"unknown\""},
        BadScene{"data = 'knee'\n" TISSUE, 1, "data is a text", "write [data]"},
        BadScene{"tissue = 5\n", 1, "tissue is a whole number", "write [[tissue]]"},
        BadScene{"tissue = [5]\n", 1, "tissue is a whole number", "write [[tissue]]"},
        BadScene{"[tissue]\nname = 'a'\n", 1, "tissue is a table", "write [[tissue]]"},
        BadScene{TISSUE "[data]\nscan = \"a\\u0000b\"\n", 5, "zero byte", ""},
        BadScene{"[[tissue]]\nname = 'a'\nlabels = 'femur'\n", 3, "labels is a text",
                 "a list of label names"},
        BadScene{"[[tissue]]\nname = 'a'\nlabels = []\n", 3, "labels is an empty list", "at least one"},
        BadScene{"[[tissue]]\nname = 'a'\nlabels = [1.5]\n", 3, "labels holds a number",
                 "a list of label names"},
        BadScene{"[[tissue]]\nname = 'a'\nlabels = [\n  1,\n  70000]\n", 5,
                 "labels = 70000 is outside 1 ... 65535", ""},
        BadScene{"[[tissue]]\nname = 'a'\nlabels = [0]\n", 3, "labels = 0 is outside", ""},
        BadScene{"[[tissue]]\nname = 'a'\nthreshold = 150\n", 3, "threshold is not a list of two numbers",
                 ""},
        BadScene{"[[tissue]]\nname = 'a'\nthreshold = [1, 2, 3]\n", 3,
                 "threshold is not a list of two numbers", ""},
        BadScene{"[[tissue]]\nname = 'a'\nthreshold = [2, 'x']\n", 3, "holds a text instead of a number", ""},
        BadScene{"[[tissue]]\nname = 'a'\nthreshold = [2, 2]\n", 3, "begins at 2, which is not below",
                 "lower number first"},
        BadScene{TISSUE "[tool]\npoints = [0, 0, 0]\n", 5, "not three numbers", "a list of points"},
        BadScene{TISSUE "[tool]\npoints = [[0, 0]]\n", 5, "not three numbers", "a list of points"},
        BadScene{TISSUE "workspace = 2\n", 4, "unknown key", ""},
        BadScene{"workspace = 2\n" TISSUE, 1, "workspace is a whole number", "write [workspace]"},
        BadScene{TISSUE "[workspace]\nscale = 'wide'\n", 5, "scale is a text",
                 "a number, 0.05 ... 20; default 1"},
        BadScene{TISSUE "[workspace]\nhome = 5\n", 5, "home is a whole number",
                 "a point [x, y, z], -1000 ... 1000 mm; default [0, 0, 0]"},
        BadScene{TISSUE "[workspace]\nhome = [1, 2]\n", 5, "not three numbers", "a point [x, y, z]"},
        BadScene{TISSUE "[workspace]\n\nhome = [1, 'a', 2]\n", 6, "holds a text instead of a number", ""},
        BadScene{TISSUE "[workspace]\nclutch_button = 1.5\n", 5, "clutch_button is a number",
                 "a whole number, 0 ... 31"}));

INSTANTIATE_TEST_SUITE_P(
    Ranges, ParseSceneError,
    testing::Values(
        BadScene{TISSUE "stiffness = 20.01\n", 4, "stiffness = 20.01 is outside 0.001 ... 20 N/mm", ""},
        BadScene{TISSUE "stiffness = 0\n", 4, "stiffness = 0 is outside", ""},
        BadScene{TISSUE "stiffness = nan\n", 4, "stiffness is not a finite number", ""},
        BadScene{TISSUE "stiffness = -inf\n", 4, "stiffness is not a finite number", ""},
        BadScene{TISSUE "friction = 2.5\n", 4, "outside 0 ... 2", ""},
        BadScene{TISSUE "friction_damping = 0.2\n", 4, "outside 0 ... 0.1 N·s/mm", ""},
        BadScene{TISSUE "friction_max = -1\n", 4, "outside 0 ... 10 N", ""},
        BadScene{TISSUE "viscosity = 1\n", 4, "outside 0 ... 0.1 N·s/mm", ""},
        BadScene{"[[tissue]]\nname = 'a'\nthreshold = [0, 1e300]\n", 3,
                 "outside -1000000000 ... 1000000000 the scan's unit", ""},
        BadScene{"[[tissue]]\nname = 'a'\nthreshold = [0, inf]\n", 3, "not a finite number", ""},
        BadScene{"[[tissue]]\nname = 'a'\nlabels = [1]\nfriction = 0.3\nstatic_friction = 0.2\n", 5,
                 "static_friction = 0.2 is less than friction = 0.3",
                 "must be at least as large as sliding friction"},
        BadScene{TISSUE "[force]\nmethod = 'spline'\n", 5, "unknown method", "\"trilinear\""},
        BadScene{TISSUE "[force]\nsphere_sigma = 2.5\n", 5, "sphere_sigma = 2.5 is outside 0.5 ... 2", ""},
        BadScene{TISSUE "[force]\nnormals = 'float'\n", 5, "unknown normals", "\"octahedral16\""},
        BadScene{TISSUE "[preparation]\nsigma = 10.5\n", 5, "sigma = 10.5 is outside 0 ... 10 mm", ""},
        BadScene{TISSUE "[preparation]\nbits = 12\n", 5, "bits = 12 is neither 8 nor 16", ""},
        BadScene{TISSUE "[preparation]\nbits = 8.0\n", 5, "bits is a number", "a whole number"},
        BadScene{TISSUE "[limits]\nmax_force = 41\n", 5, "max_force = 41 is outside 0.1 ... 40 N", ""},
        BadScene{TISSUE "[workspace]\nscale = 0.04\n", 5, "scale = 0.04 is outside 0.05 ... 20", ""},
        BadScene{TISSUE "[workspace]\nscale = 2\nforce_gain = 20.5\n", 6,
                 "force_gain = 20.5 is outside 0.05 ... 20", ""},
        BadScene{TISSUE "[workspace]\nforce_gain = -1\n", 5, "force_gain = -1 is outside", ""},
        BadScene{TISSUE "[workspace]\nscale = nan\n", 5, "scale is not a finite number", ""},
        BadScene{TISSUE "[workspace]\nyaw = 181\n", 5, "yaw = 181 is outside -180 ... 180 degrees", ""},
        BadScene{TISSUE "[workspace]\nhome = [0, 0, 1001]\n", 5, "home = 1001 is outside -1000 ... 1000 mm",
                 ""},
        BadScene{TISSUE "[workspace]\nhome = [0, inf, 0]\n", 5, "home is not a finite number", ""},
        BadScene{TISSUE "[workspace]\nclutch_button = 32\n", 5, "clutch_button = 32 is outside 0 ... 31", ""},
        BadScene{TISSUE "[workspace]\nclutch_button = -1\n", 5, "clutch_button = -1 is outside", ""},
        BadScene{TISSUE "[tool]\npoints = [[0, 0, 101]]\n", 5, "points = 101 is outside -100 ... 100 mm", ""},
        BadScene{TISSUE "[tool]\npoints = []\n", 5, "points has 0 points", "1 to 4"},
        BadScene{TISSUE "[tool]\npoints = [[0,0,0],[0,0,0],[0,0,0],[0,0,0],[0,0,0]]\n", 5,
                 "points has 5 points", ""}));

INSTANTIATE_TEST_SUITE_P(
    Meaning, ParseSceneError,
    testing::Values(
        BadScene{"", 1, "the scene has no tissue", "add a [[tissue]]"},
        BadScene{"[[tissue]]\nlabels = [1]\n", 1, "a tissue without a name", "name = "},
        BadScene{"[[tissue]]\nname = ''\nlabels = [1]\n", 2, "name is empty", ""},
        BadScene{"[[tissue]]\nname = 'a'\n", 1, "neither labels nor a threshold", ""},
        BadScene{TISSUE "threshold = [1, 2]\n", 1, "both labels and a threshold", ""},
        BadScene{TISSUE "embedding = true\n", 4, "is an embedding, but has labels as well", ""},
        BadScene{TISSUE "air_below = -400\n", 4, "has air_below but is not an embedding", "embedding = true"},
        BadScene{"[[tissue]]\nname = 'a'\nembedding = true\n[[tissue]]\nname = 'b'\nembedding = "
                 "true\n[data]\nlabels = 'l'\n",
                 1, "more than one tissue is an embedding", ""},
        BadScene{"[[tissue]]\nname = 'a'\nembedding = true\nair_below = -400\n[data]\nlabels = 'l'\n", 1,
                 "has air_below, but the scene has no scan", "scan = "},
        BadScene{"[[tissue]]\nname = 'a'\nembedding = true\n[data]\nscan = 's'\n", 1,
                 "embeds labels, but the scene has no label map", "labels = "},
        BadScene{"[[tissue]]\nname = 'a'\nthreshold = [1, 2]\noptional = true\n", 4, "cannot be optional",
                 ""},
        BadScene{TISSUE "\n[[tissue]]\nname = 'a'\nlabels = [2]\n", 5,
                 "a second tissue \"a\"; the first is on line 1", ""},
        BadScene{TISSUE "rests_on = ['bone']\n[[tissue]]\nname = 'bones'\nlabels = [2]\n", 1,
                 "rests on \"bone\", which is not a tissue of this scene",
                 "did you mean \"bones\"? the tissues are a, bones"},
        BadScene{TISSUE "rests_on = ['skull']\n", 1, "rests on \"skull\"", "the tissues are a"},
        BadScene{"device = 'touch'\n[[step]]\napproach = 'femur'\n", 2, "a palpation script, not a scene",
                 "--script"},
        BadScene{TISSUE "rests_on = ['a']\n", 1, "is circular: a on a", ""},
        BadScene{TISSUE "rests_on = ['b']\n[[tissue]]\nname = 'b'\nlabels = [2]\nrests_on = ['c']\n"
                        "[[tissue]]\nname = 'c'\nlabels = [3]\nrests_on = ['b']\n",
                 5, "is circular: b on c on b", ""},
        BadScene{TISSUE "rests_on = ['b']\nstiffness = 1.5\n[[tissue]]\nname = 'b'\nlabels = [2]\n", 1,
                 "\"a\" (1.5 N/mm) is stiffer than \"b\" (1 N/mm)", "inward"},
        BadScene{TISSUE "rests_on = ['b']\n[[tissue]]\nname = 'b'\nlabels = [2]\ntouchable = false\n", 1,
                 "rests on \"b\", which is not touchable", "inward"},
        BadScene{TISSUE "[data]\n", 4, "neither a scan nor labels", "labels = "},
        BadScene{TISSUE "[data]\nscan = 's'\n", 1, "has labels, but the scene has no label map", "labels = "},
        BadScene{"[[tissue]]\nname = 'a'\nthreshold = [1, 2]\n[data]\nlabels = 'l'\n", 1,
                 "has a threshold, but the scene has no scan", "scan = "},
        BadScene{"[[tissue]]\nname = 'a'\nthreshold = [1, 2]\n[data]\nscan = 's'\nnames = 'n'\n", 4,
                 "names for labels but no labels", ""}));

TEST(Nearest, SuggestsOnlyLikelyMisspellings) {
  const std::vector<std::string_view> names{"femur", "tibia", "femoral_cartilage"};
  EXPECT_EQ(closest_match("tibea", names), "tibia");
  EXPECT_EQ(closest_match("Tibia", names), "tibia");
  EXPECT_EQ(closest_match("FEMUR", names), "femur");
  EXPECT_EQ(closest_match("femru", names), "femur");
  EXPECT_EQ(closest_match("femoral cartilage", names), "femoral_cartilage");
  EXPECT_EQ(closest_match("femorale_cartilages", names), "femoral_cartilage");
  EXPECT_EQ(closest_match("fibula", names), "");
  EXPECT_EQ(closest_match("up", names), "");
  EXPECT_EQ(closest_match("", names), "");
  EXPECT_EQ(closest_match("femur", {}), "");
  EXPECT_EQ(did_you_mean("tibea", names, "'"), "did you mean 'tibia'? ");
  EXPECT_EQ(did_you_mean("up", names), "");
}

TEST(ParseScene, TakesEverySide) {
  for (const auto& [text, side] : {std::pair{"left", Side::kLeft},
                                   {"right", Side::kRight},
                                   {"both", Side::kBoth},
                                   {"unknown", Side::kUnknown}}) {
    const auto scene = parse_scene("side = '" + std::string(text) + "'\n" TISSUE, "t");
    ASSERT_TRUE(scene.ok()) << scene.error().message();
    EXPECT_EQ(scene->side, side);
  }
}

TEST(NumberText, IsShortAndReadsBack) {
  for (const auto& [value, text] : {std::pair{0.1, "0.1"},
                                    {1e9, "1000000000"},
                                    {-2.5, "-2.5"},
                                    {0.0, "0"},
                                    {9007199254740991.0, "9007199254740991"},
                                    {1e300, "1e+300"},
                                    {1e-9, "1e-09"}}) {
    EXPECT_EQ(number_text(value), text);
    EXPECT_EQ(std::stod(number_text(value)), value);
  }
}

TEST(ParseScene, UnfeltTissueMayRestOnAnything) {
  EXPECT_TRUE(
      parse_scene(
          TISSUE "touchable = false\nstiffness = 5\nrests_on = ['b']\n[[tissue]]\nname = 'b'\nlabels = [2]\n",
          "t")
          .ok());
}

TEST(ParseScene, LimitsTissuesAndSize) {
  std::string text;
  for (std::size_t i = 1; i <= kMaxTissues; ++i)
    text += "[[tissue]]\nname = 'a" + std::to_string(i) + "'\nlabels = [" + std::to_string(i) + "]\n";
  EXPECT_TRUE(parse_scene(text, "t").ok());
  const auto too_many = parse_scene(text + "[[tissue]]\nname = 'one more'\nlabels = [100]\n", "t");
  ASSERT_FALSE(too_many.ok());
  EXPECT_EQ(too_many.error().where, "t:" + std::to_string(3 * kMaxTissues + 1));
  EXPECT_THAT(too_many.error().what, HasSubstr("65 tissues, more than 64"));

  text.resize(kMaxSceneBytes, '\n');
  EXPECT_TRUE(parse_scene(text, "t").ok());
  const auto too_long = parse_scene(text + "\n", "t");
  ASSERT_FALSE(too_long.ok());
  EXPECT_THAT(too_long.error().what, HasSubstr("4194305 bytes"));
}

// algorithms worse than linear in the text would run for minutes on these
TEST(ParseScene, HostileTextsAreRefusedSoon) {
  const auto filled = [](std::string text, const std::function<std::string(int)>& unit) {
    for (int i = 0; text.size() < kMaxSceneBytes - 100; ++i) text += unit(i);
    return text;
  };
  const auto unknown_key = [](int i) {
    std::string line = "k";
    line += std::to_string(i);
    return line += "=1\n";
  };
  EXPECT_FALSE(parse_scene(filled("", unknown_key), "t").ok());
  EXPECT_FALSE(parse_scene(filled(TISSUE, unknown_key), "t").ok());
  EXPECT_FALSE(parse_scene(filled(TISSUE "rests_on = [", [](int) { return "'b',"; }) + "]", "t").ok());
  EXPECT_FALSE(parse_scene(filled("tissue = [", [](int) { return "5,"; }) + "]", "t").ok());
  EXPECT_FALSE(parse_scene(filled("", [](int) { return "[[tissue]]\n"; }), "t").ok());
  EXPECT_FALSE(parse_scene(filled("'", [](int) { return "x"; }) + "' = 1\n" TISSUE, "t").ok());
  const auto many_labels = parse_scene(
      filled("[[tissue]]\nname = 'a'\noptional = true\nlabels = [", [](int) { return "'b',"; }) + "]", "t");
  ASSERT_TRUE(many_labels.ok()) << many_labels.error().message();
  LabelMap map;
  for (int id = 1; id < 1000; ++id) map.segments.push_back({static_cast<LabelId>(id), "x", {}, 0, 0});
  EXPECT_TRUE(resolve_labels(*many_labels, map).ok());
}

class LoadScene : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::temp_directory_path() / ("palpate-scene-test-" + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path write(const std::string& text) {
    const fs::path file = folder_ / "scene.toml";
    std::ofstream(file, std::ios::binary) << text;
    return file;
  }
  fs::path folder_;
};

TEST_F(LoadScene, ResolvesPathsRelativeToTheSceneFile) {
  const fs::path labels = folder_ / "elsewhere.nrrd";
  std::ofstream(folder_ / "scan.nii.gz") << "x";
  std::ofstream{labels} << "x";
  const auto scene =
      load_scene(write("[data]\nscan = 'scan.nii.gz'\nlabels = '" + labels.string() + "'\n" TISSUE));
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  EXPECT_EQ(scene->resolve(*scene->scan), folder_ / "scan.nii.gz");
  EXPECT_EQ(scene->resolve(*scene->labels), labels);
}

TEST_F(LoadScene, AFileThatIsNotThereIsNamedWithItsLine) {
  const fs::path labels = folder_ / "labels.nrrd";
  std::ofstream{labels} << "x";
  const auto scene =
      load_scene(write("[data]\nlabels = 'labels.nrrd'\nnames = 'absent/names.ctbl'\n" TISSUE));
  ASSERT_FALSE(scene.ok());
  EXPECT_EQ(scene.error().where, (folder_ / "scene.toml").string() + ":3");
  EXPECT_THAT(scene.error().what, HasSubstr((folder_ / "absent" / "names.ctbl").string()));
}

TEST_F(LoadScene, NeedsData) {
  const auto scene = load_scene(write("[[tissue]]\nname = 'a'\nlabels = [1]\n"));
  ASSERT_FALSE(scene.ok());
  EXPECT_THAT(scene.error().what, HasSubstr("names no data"));
}

TEST_F(LoadScene, ErrorsNameTheFile) {
  EXPECT_FALSE(load_scene(folder_ / "absent.toml").ok());
  const auto scene = load_scene(write("title = 5\n"));
  ASSERT_FALSE(scene.ok());
  EXPECT_EQ(scene.error().where, (folder_ / "scene.toml").string() + ":1");
}

TEST_F(LoadScene, WritesWholeFiles) {
  const fs::path file = folder_ / "new.toml";
  ASSERT_TRUE(write_scene_text(file, kKnee).ok());
  std::ifstream written(file, std::ios::binary);
  EXPECT_EQ(std::string((std::istreambuf_iterator<char>(written)), {}), kKnee);
  const auto failed = write_scene_text(folder_ / "absent" / "new.toml", kKnee);
  ASSERT_FALSE(failed.ok());
  EXPECT_EQ(failed.error().kind, ErrorKind::kOutput);
}

TEST(EmbeddedScene, EveryOneParses) {
  for (const char* name :
       {"knee", "knee-phantom", "knee-atlas", "head", "shell-phantom", "skull-phantom", "gland-phantom",
        "palpation-block", "palpation-dome", "abdominal-wall", "temporal-bone"}) {
    const auto text = embedded_scene(name);
    ASSERT_TRUE(text.has_value()) << name;
    const auto scene = parse_scene(*text, name);
    ASSERT_TRUE(scene.ok()) << scene.error().message();
    EXPECT_FALSE(scene->scan || scene->labels);
  }
  EXPECT_EQ(embedded_scene("knee-phantom"), embedded_scene("knee-atlas"));
  EXPECT_FALSE(embedded_scene("elbow").has_value());
}

TEST(EmbeddedScene, IsTheFileInData) {
  std::ifstream file(PALPATE_SOURCE_DIR "/data/scenes/knee.toml", std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(file)), {});
  EXPECT_EQ(embedded_scene("knee"), text);
}

TEST(EmbeddedScene, KneeHasATouchableJointOnly) {
  const auto scene = parse_scene(*embedded_scene("knee"), "knee.toml");
  ASSERT_TRUE(scene.ok());
  EXPECT_EQ(scene->side, Side::kUnknown) << "the anatomy tells";
  for (const TissueSettings& tissue : scene->tissues) {
    const bool of_the_joint = tissue.name == "bone" || tissue.name == "cartilage" ||
                              tissue.name == "meniscus" || tissue.name == "ligament";
    EXPECT_EQ(tissue.touchable, of_the_joint) << tissue.name;
  }
}

// every soft tissue has a modulus in case the law is changed, and scenes with an elastic law use it
TEST(EmbeddedScene, SoftTissuesHaveElasticConstants) {
  for (const std::string name : {"knee", "head", "skull-phantom", "gland-phantom", "palpation-block",
                                 "palpation-dome", "abdominal-wall", "temporal-bone"}) {
    SCOPED_TRACE(name);
    std::string text(*embedded_scene(name));
    if (name == "knee") text += *embedded_scene("lesion-in-knee");
    const auto scene = parse_scene(text, name);
    ASSERT_TRUE(scene.ok()) << scene.error().message();
    for (const TissueSettings& tissue : scene->tissues)
      EXPECT_EQ(tissue.elastic.has_value(), tissue.preset != "bone") << tissue.name;
    const bool is_deformable = name.starts_with("palpation") || name == "abdominal-wall";
    EXPECT_EQ(scene->deformation.law, is_deformable ? TissueLaw::kElastic : TissueLaw::kLayers);
  }
}

TEST(EmbeddedScene, HeadTakesEveryRegionOnce) {
  const auto scene = parse_scene(*embedded_scene("head"), "head.toml");
  ASSERT_TRUE(scene.ok());
  std::vector<int> ids;
  for (const TissueSettings& tissue : scene->tissues)
    for (const LabelReference& label : tissue.labels) ids.push_back(std::get<int>(label));
  std::sort(ids.begin(), ids.end());
  EXPECT_EQ(scene->side, Side::kBoth);
  ASSERT_EQ(ids.size(), 116u);
  for (int i = 0; i < 116; ++i) EXPECT_EQ(ids[static_cast<std::size_t>(i)], i + 1);
}

}  // namespace
}  // namespace palpate
