#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <sstream>

#include "base/test_files.h"
#include "palpate/scene/scene.h"
#include "palpate/scene/tissue_presets.h"
#include "scene/keys.h"

namespace palpate {
namespace {

using testing::ElementsAreArray;

std::string preset_of(const std::string& name) {
  const TissuePreset* preset = match_preset(name).preset;
  return preset ? preset->name : "";
}

/// The names in a colour table of 3D Slicer.
std::vector<std::string> colour_table_names(const std::string& path) {
  std::ifstream file(path);
  std::vector<std::string> names;
  for (std::string line; std::getline(file, line);) {
    std::istringstream words(line);
    std::string id, name;
    if (words >> id >> name && id != "#") names.push_back(name);
  }
  return names;
}

double stiffness_of(const std::string& name) {
  for (const TissuePreset& preset : tissue_presets()) {
    if (preset.name == name) return preset.values.stiffness_N_per_mm;
  }
  ADD_FAILURE() << name;
  return 0;
}

TEST(TissuePresets, AreTheChoicesOfTheKey) {
  std::vector<std::string_view> names;
  for (const TissuePreset& preset : tissue_presets()) names.push_back(preset.name);
  EXPECT_THAT(scene_key_tables().tissue.find("preset")->choices, ElementsAreArray(names));
}

TEST(TissuePresets, EveryValueIsOneThatASceneMayHave) {
  for (const TissuePreset& preset : tissue_presets()) {
    const TissueSettings& v = preset.values;
    for (const auto& [key, value] : {std::pair{"stiffness", v.stiffness_N_per_mm},
                                     {"friction", v.friction},
                                     {"friction_damping", v.friction_damping_N_s_per_mm},
                                     {"friction_max", v.friction_max_N},
                                     {"viscosity", v.viscosity_N_s_per_mm},
                                     {"opacity", v.opacity}}) {
      const KeySpec& spec = *scene_key_tables().tissue.find(key);
      EXPECT_GE(value, spec.min) << preset.name << " " << key;
      EXPECT_LE(value, spec.max) << preset.name << " " << key;
    }
    EXPECT_FALSE(preset.source.empty());
    EXPECT_TRUE(v.touchable);
    EXPECT_EQ(v.preset, preset.name);
  }
}

// expected values: stiffness of each published modulus under a flat punch of 1.5 mm radius, computed by hand,
// in series with a spring of 1.5 N/mm
TEST(TissuePresets, StiffnessFollowsFromThePublishedModulus) {
  EXPECT_EQ(stiffness_of("bone"), 1.5);          // 61 kN/mm
  EXPECT_EQ(stiffness_of("ligament"), 0.31);     // 4 * 0.096 = 0.384 N/mm
  EXPECT_EQ(stiffness_of("cartilage"), 0.91);    // 3 * 0.7724 / 0.99 = 2.341 N/mm
  EXPECT_EQ(stiffness_of("meniscus"), 0.29);     // 3 * 0.12 = 0.36 N/mm
  EXPECT_EQ(stiffness_of("nerve"), 0.14);        // 4 * 0.0387 = 0.155 N/mm
  EXPECT_EQ(stiffness_of("muscle"), 0.052);      // 4 * 0.0135 = 0.054 N/mm
  EXPECT_EQ(stiffness_of("vessel"), 0.046);      // 0.771 * 0.25 / (0.149 * 27) = 0.0479 N/mm
  EXPECT_EQ(stiffness_of("fat"), 0.036);         // 4 * 0.00912 = 0.0365 N/mm
  EXPECT_EQ(stiffness_of("disc"), 1.0);          // 3 * 0.98756 / 0.99 = 2.993 N/mm
  EXPECT_EQ(stiffness_of("skin"), 0.38);         // 4 * 0.129 = 0.516 N/mm
  EXPECT_EQ(stiffness_of("tumour"), 0.15);       // 4 * 0.04252 = 0.170 N/mm
  EXPECT_EQ(stiffness_of("lymph node"), 0.081);  // 4 * 0.0214 = 0.0856 N/mm
  EXPECT_EQ(stiffness_of("gland"), 0.042);       // 4 * 0.01092 = 0.0437 N/mm
  EXPECT_EQ(stiffness_of("kidney"), 0.02);       // 4 * 0.005 = 0.02 N/mm
  EXPECT_EQ(stiffness_of("spleen"), 0.012);      // 4 * 0.0029 = 0.0116 N/mm
  EXPECT_EQ(stiffness_of("liver"), 0.025);       // 4 * 3 * 0.00209 = 0.0251 N/mm
  EXPECT_EQ(stiffness_of("heart"), 0.013);       // 4 * 0.0034 = 0.0136 N/mm
  EXPECT_EQ(stiffness_of("lung"), 0.014);        // 4 * 3 * 0.00114 = 0.0137 N/mm
  EXPECT_EQ(stiffness_of("brain"), 0.008);       // 4 * 0.001895 = 0.0076 N/mm
}

// every soft preset has a modulus in the range of the key; only bone is rigid
TEST(TissuePresets, SoftPresetsHaveElasticConstants) {
  const TableSpec& keys = scene_key_tables().tissue;
  for (const TissuePreset& preset : tissue_presets()) {
    const auto& elastic = preset.values.elastic;
    ASSERT_EQ(elastic.has_value(), preset.name != "bone") << preset.name;
    if (!elastic) continue;
    EXPECT_FALSE(range_error(*keys.find("youngs_modulus"), elastic->youngs_modulus_kPa)) << preset.name;
    EXPECT_FALSE(range_error(*keys.find("poissons_ratio"), elastic->poissons_ratio)) << preset.name;
  }
}

// every relaxation is valid in a scene and comes with a modulus
TEST(TissuePresets, RelaxationTimesAreInRange) {
  const KeySpec& key = *scene_key_tables().tissue.find("relaxation");
  int relax = 0;
  for (const TissuePreset& preset : tissue_presets()) {
    const Relaxation& relaxation = preset.values.relaxation;
    if (!relaxation.relaxes()) continue;
    ++relax;
    EXPECT_TRUE(preset.values.elastic.has_value()) << preset.name;
    EXPECT_LT(relaxation.total_fraction(), 1) << preset.name;
    for (const RelaxationTerm& term : relaxation.term)
      EXPECT_TRUE(term.fraction == 0 || !range_error(key, term.time_s)) << preset.name;
  }
  EXPECT_EQ(relax, 3);
}

// under the same flat punch the moduli give the stiffnesses, E = K (1 - nu^2) / 2 a, up to rounding to two
// digits and a different nu
TEST(TissuePresets, ModuliAndStiffnessesAreOfTheSameTissue) {
  for (const TissuePreset& preset : tissue_presets()) {
    if (!preset.values.elastic) continue;
    const auto& [modulus_kPa, ratio, stiffening] = *preset.values.elastic;
    EXPECT_FALSE(range_error(*scene_key_tables().tissue.find("stiffening"), stiffening)) << preset.name;
    const double punch_N_per_mm = 2 * 1.5 * 1e-3 * modulus_kPa / (1 - ratio * ratio);
    const double stiffness_N_per_mm = punch_N_per_mm * 1.5 / (punch_N_per_mm + 1.5);
    EXPECT_NEAR(stiffness_N_per_mm, preset.values.stiffness_N_per_mm, 0.15 * preset.values.stiffness_N_per_mm)
        << preset.name;
  }
}

TEST(TissuePresets, OrgansStiffenWithinTheirRangeAndMeatDoesNot) {
  const std::string table = elastic_preset_table();
  for (const char* name : {"liver", "kidney", "spleen", "nerve"}) {
    EXPECT_GT(find_preset(name)->values.elastic->stiffening, 0) << name;
    EXPECT_NE(table.find(std::string("| `") + name), table.npos);
  }
  for (const char* name : {"muscle", "fat", "cartilage"})
    EXPECT_EQ(find_preset(name)->values.elastic->stiffening, 0) << name;
  for (const TissuePreset& preset : tissue_presets()) {
    if (!preset.values.elastic) continue;
    EXPECT_GE(preset.values.elastic->youngs_modulus_kPa, preset.range_kPa[0]) << preset.name;
    EXPECT_LE(preset.values.elastic->youngs_modulus_kPa, preset.range_kPa[1]) << preset.name;
  }
}

TEST(MatchPreset, SmallBonesAreBone) {
  for (const char* name : {"Malleus", "incus_left", "stapes", "auditory_ossicles", "mandibular condyle",
                           "left_condylar_process"}) {
    const PresetMatch match = match_preset(name);
    ASSERT_NE(match.preset, nullptr) << name;
    EXPECT_EQ(match.preset->name, "bone") << name;
  }
}

TEST(TissuePresets, AreOrderedAsAProbeFindsThem) {
  for (const auto& [stiffer, softer] : {std::pair{"bone", "cartilage"},
                                        {"cartilage", "ligament"},
                                        {"cartilage", "meniscus"},
                                        {"ligament", "muscle"},
                                        {"muscle", "fat"}})
    EXPECT_GT(stiffness_of(stiffer), stiffness_of(softer)) << stiffer << " and " << softer;
}

TEST(TissuePresets, ColoursAreDistinct) {
  const auto& presets = tissue_presets();
  for (std::size_t a = 0; a < presets.size(); ++a) {
    ASSERT_TRUE(presets[a].values.colour.has_value()) << presets[a].name;
    for (std::size_t b = 0; b < a; ++b) {
      const Rgb &one = *presets[a].values.colour, &other = *presets[b].values.colour;
      EXPECT_GE(std::hypot(one.r - other.r, one.g - other.g, one.b - other.b), 30)
          << presets[a].name << " and " << presets[b].name;
    }
  }
}

TEST(MatchPreset, KnowsEveryNameOfTheKneeAtlas) {
  const std::vector<std::pair<std::string, std::vector<std::string>>> expected{
      {"bone", {"femur", "tibia", "fibula", "patella"}},
      {"cartilage",
       {"femoral_cartilage", "lateral_tibial_cartilage", "medial_tibial_cartilage", "patellar_cartilage"}},
      {"meniscus", {"lateral_meniscus", "medial_meniscus"}},
      {"ligament",
       {"anterior_cruciate_ligament", "posterior_cruciate_ligament", "fibular_collateral_ligament",
        "tibial_collateral_ligament", "patellar_ligament", "adductor_magnus_tendon", "biceps_femoris_tendon",
        "iliotibial_tract", "popliteus_tendon", "soleus_tendon", "semitendinosus_tendon", "gracilis_tendon"}},
      {"muscle",
       {"vastus_lateralis_muscle", "vastus_medialis_muscle", "biceps_femoris_muscle",
        "semimembranosus_muscle", "semitendinosus_muscle", "gracilis_muscle", "sartorius_muscle",
        "medial_head_gastrocnemius_muscle", "lateral_head_gastrocnemius_muscle", "popliteus_muscle",
        "soleus_muscle", "tibialis_anterior_muscle", "extensor_digitorum_longus_muscle",
        "peroneus_longus_muscle"}},
      {"fat", {"infrapatellar_fat_body"}},
      {"vessel",
       {"popliteal_artery", "popliteal_vein", "superior_medial_genicular_artery",
        "superior_lateral_genicular_artery", "middle_genicular_artery", "great_saphenous_vein",
        "small_saphenous_vein"}},
      {"nerve",
       {"peroneus_nerve", "tibialis_nerve", "muscular_branches_tibialis_nerve",
        "medial_sural_cutaneous_nerve"}}};
  for (const auto& [preset, names] : expected)
    for (const std::string& name : names) EXPECT_EQ(preset_of(name), preset) << name;
}

TEST(MatchPreset, KnowsNamesOfWholeBodySegmentations) {
  const std::vector<std::pair<std::string, std::vector<std::string>>> expected{
      {"bone", {"vertebrae_L5", "vertebrae_S1",  "rib_left_4",     "rib_right_12",  "sacrum",
                "hip_left",     "scapula_right", "clavicula_left", "humerus_right", "femur_left",
                "skull",        "sternum",       "carpal",         "metatarsal",    "phalanges_hand",
                "ulna",         "radius",        "LeftFemur",      "Femur2",        "T12 vertebra",
                "bone"}},
      {"cartilage", {"costal_cartilages", "Cartilage of the femur", "femurCartilage"}},
      {"muscle", {"gluteus_maximus_left", "autochthon_right", "iliopsoas_left", "skeletal_muscle"}},
      {"fat", {"subcutaneous_fat", "torso_fat", "intermuscular_fat"}},
      {"vessel",
       {"aorta", "inferior_vena_cava", "portal_vein_and_splenic_vein", "iliac_artery_left",
        "iliac_vena_right", "pulmonary_vein", "brachiocephalic_trunk", "common_carotid_artery_left"}},
      {"nerve", {"sciatic_nerve", "brachial_plexus"}},
      {"ligament", {"Achilles Tendon", "patella tendon", "ACL", "ligamentum_flavum", "iliotibial band"}},
      {"liver", {"liver", "Liver", "caudate_lobe"}},
      {"spleen", {"spleen"}},
      {"kidney", {"kidney_right", "renal_cortex"}},
      {"lung", {"lung_upper_lobe_left", "Lungs"}},
      {"heart", {"heart", "heart_atrium_left", "atrial_appendage_left", "heart_myocardium"}},
      {"brain", {"brain", "Hippocampus_L"}},
      {"gland", {"adrenal_gland_left", "thyroid_gland", "prostate", "pancreas", "parotid_gland_left"}},
      {"",
       {"", "spinal_cord", "Rectus_L", "trunk", "tract", "tribute", "fibril", "label 3", "95", "stomach",
        "urinary_bladder", "kidney_cyst_left", "pleural_effusion"}}};
  for (const auto& [preset, names] : expected)
    for (const std::string& name : names) EXPECT_EQ(preset_of(name), preset) << name;
}

TEST(MatchPreset, KnowsNamesOfFreeSurfer) {
  const std::vector<std::pair<std::string, std::vector<std::string>>> expected{
      {"brain",
       {"Left-Cerebral-White-Matter", "Left-Cerebral-Cortex", "Right-Cerebellum-Cortex",
        "Left-Thalamus-Proper", "Left-Caudate", "Left-Putamen", "Left-Pallidum", "Brain-Stem",
        "Left-Hippocampus", "Left-Amygdala", "Left-Accumbens-area", "ctx-lh-precuneus",
        "ctx-rh-superiorfrontal"}},
      {"vessel", {"Left-vessel", "Left-choroid-plexus"}},
      {"nerve", {"Optic-Chiasm", "Optic-Nerve"}},
      {"bone", {"Skull"}},
      {"skin", {"Head-Skin"}},
      {"", {"Unknown", "Left-Lateral-Ventricle", "CSF", "3rd-Ventricle", "WM-hypointensities"}}};
  for (const auto& [preset, names] : expected)
    for (const std::string& name : names) EXPECT_EQ(preset_of(name), preset) << name;
}

TEST(MatchPreset, KnowsMoreWordsOfAnatomy) {
  const std::vector<std::pair<std::string, std::vector<std::string>>> expected{
      {"bone",
       {"hyoid", "Hyoid bone", "mandible", "lower jaw", "cranium", "rib 3", "vertebral body L4", "teeth"}},
      {"cartilage", {"thyroid cartilage", "cricoid cartilage"}},
      {"disc", {"disc_L4_L5", "intervertebral disks", "Discs", "nucleus pulposus"}},
      {"muscle",
       {"sternocleidomastoid_left", "vastus lateralis", "rectus femoris", "M. erector spinae",
        "quadriceps_femoris_left", "diaphragm"}},
      {"fat", {"Hoffa fat pad", "subcutaneous adipose tissue"}},
      {"skin", {"skin", "Dermis"}},
      {"vessel",
       {"hepatic_vessels", "renal vein", "Arteria carotis", "internal_carotid_right", "lung_vessels"}},
      {"nerve", {"optic disc", "Nervus medianus"}},
      {"gland", {"submandibular gland", "Parotid_L", "glandula lacrimalis"}},
      {"lymph node", {"lymph nodes", "LymphNode_3", "axillary lymph node"}},
      {"tumour", {"liver_tumor", "brain tumour core", "Lesion", "lung_nodule", "lesion of the femur", "GTV"}},
      // a word inside another word does not match
      {"",
       {"discharge", "discovery", "ribbon", "liverwort", "heartburn", "brainstorm", "skinny", "fatal",
        "boneless", "glandless", "jawline", "veinlet", "lungfish", "fluid in the lung", "optic radiation"}}};
  for (const auto& [preset, names] : expected)
    for (const std::string& name : names) EXPECT_EQ(preset_of(name), preset) << name;
}

// a word counts in the longest term that contains it
TEST(MatchPreset, LooksUpWholeTerms) {
  EXPECT_EQ(match_preset("sterno_thyroid_left").term, "sterno thyroid");
  EXPECT_EQ(preset_of("sterno_thyroid_left"), "muscle");
  EXPECT_EQ(preset_of("thyroid_left"), "gland");
  EXPECT_EQ(preset_of("sternothyroid thyroid"), "gland") << "each where it stands";
  EXPECT_EQ(match_preset("annulus fibrosus").term, "annulus fibrosus");
  EXPECT_EQ(preset_of("true lumen"), "vessel");
  EXPECT_EQ(match_preset("sphenoid").term, "sphenoid");
  EXPECT_EQ(match_preset("").term, "");
}

TEST(MatchPreset, TellsHollowSpacesFromNamesThatSayNothing) {
  for (const char* name : {"kidney_cyst_left", "sphenoid sinus", "lumen of the colon", "fluid in the lung",
                           "Left-Lateral-Ventricle", "CSF", "nasal cavities air"}) {
    EXPECT_TRUE(match_preset(name).is_hollow) << name;
    EXPECT_EQ(match_preset(name).preset, nullptr) << name;
  }
  for (const char* name : {"stomach", "", "hip_implant", "liver_hematoma", "lung_airways_wall"}) {
    EXPECT_FALSE(match_preset(name).is_hollow) << name;
    EXPECT_EQ(match_preset(name).preset, nullptr) << name;
  }
  EXPECT_EQ(match_preset("hip_implant").term, "implant");
  // the contents of a cavity determine the material
  EXPECT_EQ(preset_of("tumour of the trachea"), "tumour");
  EXPECT_EQ(preset_of("transverse venous sinus"), "vessel");
}

// each solid class of TotalSegmentator, by its published class map; hollow ones have no preset
TEST(MatchPreset, LeavesOfTotalSegmentatorWhatIsHollow) {
  for (const char* name : {"gallbladder", "stomach", "esophagus", "trachea", "small_bowel", "duodenum",
                           "colon", "urinary_bladder", "spinal_cord", "kidney_cyst_right"})
    EXPECT_EQ(preset_of(name), "") << name;
  for (const char* name : {"spleen",
                           "kidney_left",
                           "liver",
                           "pancreas",
                           "adrenal_gland_right",
                           "lung_middle_lobe_right",
                           "thyroid_gland",
                           "prostate",
                           "sacrum",
                           "vertebrae_C1",
                           "heart",
                           "aorta",
                           "pulmonary_vein",
                           "subclavian_artery_left",
                           "superior_vena_cava",
                           "portal_vein_and_splenic_vein",
                           "iliac_vena_left",
                           "humerus_left",
                           "scapula_left",
                           "clavicula_right",
                           "hip_left",
                           "gluteus_medius_left",
                           "autochthon_left",
                           "iliopsoas_right",
                           "brain",
                           "skull",
                           "rib_left_1",
                           "sternum",
                           "costal_cartilages"})
    EXPECT_NE(preset_of(name), "") << name;
}

// every structure of the real tables has a preset
TEST(MatchPreset, CoversTheColourTableOfTheKneeAtlas) {
  PALPATE_SHARED_FILE(path, "knee_spl/knee.ctbl");
  const std::vector<std::string> names = colour_table_names(path);
  EXPECT_EQ(names.size(), 48u);
  for (const std::string& name : names) EXPECT_NE(preset_of(name), "") << name;
}

// the embedded scene has exactly the structures of the atlas, in the tissues of their presets
TEST(EmbeddedScene, KneeIsTheAtlas) {
  PALPATE_SHARED_FILE(path, "knee_spl/knee.ctbl");
  const auto scene = parse_scene(*embedded_scene("knee-atlas"), "knee.toml");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  std::vector<std::string> labels;
  for (const TissueSettings& tissue : scene->tissues) {
    for (const LabelReference& label : tissue.labels) {
      labels.push_back(std::get<std::string>(label));
      EXPECT_EQ(preset_of(labels.back()), tissue.preset) << labels.back();
    }
  }
  EXPECT_THAT(labels, testing::UnorderedElementsAreArray(colour_table_names(path)));
}

TEST(MatchPreset, CoversTheTableOfTheDessKnee) {
  PALPATE_SHARED_FILE(path, "knee_dess/labels.tsv");
  std::ifstream file(path);
  std::string header;
  std::getline(file, header);
  int count = 0;
  for (std::string id, name; file >> id >> name; ++count) EXPECT_NE(preset_of(name), "") << name;
  EXPECT_EQ(count, 10);
}

}  // namespace
}  // namespace palpate
