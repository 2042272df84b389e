#include "volume_io/labels/anatomy_words.h"

#include <gtest/gtest.h>

#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace palpate::volume_io {
namespace {

TEST(AnatomyWords, NamesOfSegmentersStayWhole) {
  for (const std::string name : {"femur",
                                 "femur_left",
                                 "LeftFemur",
                                 "Femoral-Cartilage",
                                 "medial tibial cartilage",
                                 "rib_left_4",
                                 "vertebrae_L5",
                                 "vertebrae_C1",
                                 "vertebrae_T12",
                                 "heart_atrium_left",
                                 "portal_vein_and_splenic_vein",
                                 "inferior_vena_cava",
                                 "small_bowel",
                                 "urinary_bladder",
                                 "lung_upper_lobe_left",
                                 "costal_cartilages",
                                 "gluteus_maximus_right",
                                 "iliac_vena_left",
                                 "common_carotid_artery_right",
                                 "adrenal_gland_left",
                                 "kidney_cyst_left",
                                 "subcutaneous_fat",
                                 "torso_fat",
                                 "skeletal_muscle",
                                 "spinal_cord",
                                 "prostate",
                                 "thyroid_gland",
                                 "pulmonary_vein",
                                 "atrial_appendage_left",
                                 "autochthon_right",
                                 "skull",
                                 "Left-Cerebral-White-Matter",
                                 "Left-Thalamus",
                                 "Brain-Stem",
                                 "ctx-lh-superiorfrontal",
                                 "WM-hypointensities",
                                 "Right-VentralDC",
                                 "lh.pial",
                                 "teres_major",
                                 "L5 vertebra",
                                 "adductor_magnus",
                                 "hoffa_fat",
                                 "gluteus_medius",
                                 "common_iliac_artery",
                                 "bladder_wall"}) {
    const AnatomyInName found = anatomy_in(name);
    // a dot between words becomes an underscore
    const std::string whole = name == "lh.pial" ? "lh_pial" : name;
    EXPECT_EQ(found.name, whole);
    EXPECT_FALSE(found.left_out) << name;
  }
}

TEST(AnatomyWords, OmitsPossiblePatientNames) {
  struct Case {
    std::string text, name;
    bool left_out;
  };
  for (const Case& one : std::vector<Case>{
           {"DOE^CANARY", "", true},
           {"doe_canary_femur", "femur", true},
           {"DoeFemurLeft", "FemurLeft", true},
           {"femur-DOE-left", "femur_left", true},
           {"femur_19570411", "femur", true},
           {"femur_04_11_57", "femur", false},
           {"4711_liver", "liver", true},
           {"sub-01_liver_mask", "liver", false},
           {"seg_01", "", false},
           {"labels", "", false},
           {"left", "", false},
           {"White_femur", "femur", true},
           {"femur_major", "femur", true},
           {"Small, liver", "liver", true},
           {"M\xc3\xbcller_tibia", "tibia", true},
           {"\xff\xfe", "", true},
           {"", "", false},
           // a word that contains an anatomical word is a different word
           {"Bonenberg", "", true},
           // also a family name, which counts only next to its companion word
           {"Magnus_femur", "femur", true},
           {"magnus", "", true},
           {"Hoffa_Lien", "", true},
           {"Hoffa_femur", "femur", true},
           {"Lien", "", true},
           {"Pons_Maria_liver", "liver", true},
           {"Costa", "", true},
           {"Oral_Post_Sin_Band_Stem_Wall_Pole_femur", "femur", true},
           {"Ribbeck", "", true},
       }) {
    const AnatomyInName found = anatomy_in(one.text);
    EXPECT_EQ(found.name, one.name) << one.text;
    EXPECT_EQ(found.left_out, one.left_out) << one.text;
  }
}

TEST(AnatomyWords, NothingComesOutButWordsThatAreKnown) {
  // a non-anatomical word is dropped in every context
  for (const std::string canary : {"CANARY", "canary", "Canary"})
    for (const std::string around : {"femur", "left", "L5", "_", "12", "rib_4", "^", " ", "white matter"})
      for (const std::string& text :
           {around + canary, canary + around, around + "_" + canary, canary + "-" + around,
            around + canary + around, canary + " " + around + " " + canary}) {
        const std::string name = anatomy_in(text).name;
        std::string lower;
        for (const char c : name) lower += static_cast<char>(c >= 'A' && c <= 'Z' ? c + 32 : c);
        EXPECT_EQ(lower.find("canary"), std::string::npos) << text;
      }
}

// TotalSegmentator's classes, as its masks are named: two lumina are distinct, and so are eight segments.
TEST(AnatomyWords, MaskNamesKeepTheirSpelling) {
  std::vector<std::string> names;
  std::istringstream words(
      "abdominal_cavity aorta_false_lumen aorta_true_lumen auditory_canal_left auditory_canal_right "
      "body_extremities body_trunc bridge central_sulcus coracobrachial crown external_oblique_left "
      "external_oblique_right face fourth_ventricle hard_palate head hip_implant implant "
      "inferior_oblique_muscle_left inferior_oblique_muscle_right inferior_pharyngeal_constrictor "
      "insular_cortex intermuscular_fat internal_capsule internal_oblique_left internal_oblique_right "
      "intracerebral_hemorrhage left_coronary_cusp left_inferior_alveolar_canal "
      "left_ventricular_outflow_tract lentiform_nucleus levator_palpebrae_superioris_left "
      "levator_palpebrae_superioris_right lingual_canal lung_airways_wall lung_covid_infiltrate "
      "lung_pleural lung_trachea_bronchia mediastinum middle_pharyngeal_constrictor non_coronary_cusp "
      "pericardial_effusion phalanges_feet phalanges_hand pleural_effusion prevertebral_left "
      "prevertebral_right pul_annulus pul_bifurcation pul_left_start pul_right_start "
      "pul_sinotubular_junction right_coronary_cusp right_inferior_alveolar_canal septum_pellucidum "
      "sinotubular_junction sterno_thyroid_left sterno_thyroid_right styloid_process_left "
      "styloid_process_right subarachnoid_space superior_mesenteric_artery superior_oblique_muscle_left "
      "superior_oblique_muscle_right superior_pharyngeal_constrictor thigh_medial_compartment_left "
      "thigh_medial_compartment_right thigh_posterior_compartment_left thigh_posterior_compartment_right "
      "third_ventricle thyrohyoid_left thyrohyoid_right transversospinalis_left transversospinalis_right "
      "triceps_brachii venous_sinuses ventricle ventricle_frontal_horn_left ventricle_frontal_horn_right "
      "ventricle_occipital_horn_left ventricle_occipital_horn_right ventricle_temporal_horn_left "
      "ventricle_temporal_horn_right ventricle_trigone_left ventricle_trigone_right zygomatic_arch_left "
      "zygomatic_arch_right");
  for (std::string name; words >> name;) names.push_back(name);
  for (int segment = 1; segment <= 8; ++segment) names.push_back("liver_segment_" + std::to_string(segment));
  constexpr const char* kTeeth[] = {"central_incisor", "lateral_incisor", "canine",       "first_premolar",
                                    "second_premolar", "first_molar",     "second_molar", "third_molar"};
  constexpr const char* kQuadrants[] = {"upper_right", "upper_left", "lower_left", "lower_right"};
  for (int quadrant = 0; quadrant < 4; ++quadrant)
    for (int tooth = 0; tooth < 8; ++tooth) {
      const std::string name = std::string(kQuadrants[quadrant]) + "_" + kTeeth[tooth];
      const std::string number = std::to_string(quadrant + 1) + std::to_string(tooth + 1);
      names.push_back(name + "_fdi" + number);
      names.push_back(name + "_pulp_fdi1" + number);
    }
  names.push_back("left_mandibular_incisive_canal_fdi103");
  for (const std::string& name : names) {
    const AnatomyInName found = anatomy_in(name);
    EXPECT_EQ(found.name, name);
    EXPECT_FALSE(found.left_out) << name;
  }
}

// words that may be a person's name or number are dropped
TEST(AnatomyWords, OmitsPossiblePersonNames) {
  for (const auto& [name, kept] : {std::pair("Bridge_Anna_liver", "liver"),
                                   {"head_Crown_19700101", ""},
                                   {"hand_liver", "liver"},
                                   {"liver_103", "liver"},
                                   {"canal_fdi1033", "canal_fdi"},
                                   {"Bridge", ""},
                                   {"covid_oblique_scan", ""},
                                   {"Wall_Hard_aorta", "aorta"}}) {
    const AnatomyInName found = anatomy_in(name);
    EXPECT_EQ(found.name, kept) << name;
    EXPECT_TRUE(found.left_out) << name;
  }
}

}  // namespace
}  // namespace palpate::volume_io
