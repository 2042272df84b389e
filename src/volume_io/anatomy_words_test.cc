#include "volume_io/anatomy_words.h"

#include <gtest/gtest.h>

#include <string>
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
    // a point between words becomes an underscore
    const std::string whole = name == "lh.pial" ? "lh_pial" : name;
    EXPECT_EQ(found.name, whole);
    EXPECT_FALSE(found.left_out) << name;
  }
}

TEST(AnatomyWords, WhatMightNameAPatientIsLeftOut) {
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
           // a word that holds one of anatomy is another word
           {"Bonenberg", "", true},
           // people are called so, and it counts beside its own word only
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
  // whatever stands around it, a name that is no word of anatomy never comes through
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

}  // namespace
}  // namespace palpate::volume_io
