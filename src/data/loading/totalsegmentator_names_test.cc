#include <gtest/gtest.h>

#include <map>
#include <sstream>
#include <string>

#include "palpate/scene/tissue_presets.h"
#include "palpate/volume_io/label_tables.h"

namespace palpate {
namespace {

// Class names of TotalSegmentator by tissue. "hollow": holds air or fluid; "unknown": no preset has a source
// for the material, or it contains several tissues.
struct Row {
  const char *tissue, *names, *paired;  // names in `paired` are suffixed with _left and _right
};
constexpr Row kRows[]{
    {"bone",
     "femur hard_palate humerus hyoid skull sternum sacrum vertebrae vertebrae_body mandible lower_jawbone "
     "upper_jawbone teeth_lower teeth_upper patella tibia fibula tarsal metatarsal phalanges_feet ulna "
     "radius "
     "carpal metacarpal phalanges_hand",
     "femur hip humerus scapula clavicula zygomatic_arch styloid_process"},
    {"cartilage", "costal_cartilages thyroid_cartilage cricoid_cartilage", ""},
    {"disc", "intervertebral_discs", ""},
    {"muscle",
     "skeletal_muscle tongue soft_palate superior_pharyngeal_constrictor middle_pharyngeal_constrictor "
     "inferior_pharyngeal_constrictor deltoid supraspinatus infraspinatus subscapularis coracobrachial "
     "trapezius pectoralis_minor serratus_anterior teres_major triceps_brachii",
     "autochthon iliopsoas gluteus_maximus gluteus_medius gluteus_minimus quadriceps_femoris sartorius "
     "thigh_medial_compartment thigh_posterior_compartment pectoralis_major rectus_abdominis "
     "serratus_anterior latissimus_dorsi trapezius external_oblique internal_oblique erector_spinae "
     "transversospinalis psoas_major quadratus_lumborum masseter temporalis lateral_pterygoid "
     "medial_pterygoid digastric sternocleidomastoid platysma levator_scapulae anterior_scalene "
     "middle_scalene posterior_scalene sterno_thyroid thyrohyoid prevertebral lateral_rectus_muscle "
     "medial_rectus_muscle superior_rectus_muscle inferior_rectus_muscle superior_oblique_muscle "
     "inferior_oblique_muscle levator_palpebrae_superioris"},
    {"fat", "subcutaneous_fat torso_fat intermuscular_fat", ""},
    // includes parts of the aortic and the pulmonary root; a dissected aorta is represented by its two lumina
    {"vessel",
     "aorta aorta_true_lumen aorta_false_lumen brain_aneurysm brachiocephalic_trunk celiac_trunk "
     "superior_mesenteric_artery renal_arteries coronary_arteries pulmonary_artery pulmonary_vein "
     "superior_vena_cava inferior_vena_cava portal_vein_and_splenic_vein lung_vessels lung_arteries "
     "lung_veins "
     "liver_vessels venous_sinuses sinotubular_junction right_coronary_cusp left_coronary_cusp "
     "non_coronary_cusp pul_sinotubular_junction pul_bifurcation pul_left_start pul_right_start",
     "iliac_artery iliac_vena subclavian_artery common_carotid_artery brachiocephalic_vein "
     "internal_carotid_artery internal_jugular_vein"},
    // canals of the jaws contain a nerve with its vessels
    {"nerve",
     "left_inferior_alveolar_canal right_inferior_alveolar_canal left_mandibular_incisive_canal_fdi103 "
     "right_mandibular_incisive_canal_fdi104 lingual_canal",
     "optic_nerve"},
    {"liver", "liver", ""},
    {"kidney", "", "kidney"},
    {"spleen", "spleen", ""},
    {"lung", "lung lung_pleural lung_covid_infiltrate lung_middle_lobe_right",
     "lung lung_upper_lobe lung_lower_lobe"},
    {"heart", "heart heart_myocardium left_ventricular_outflow_tract atrial_appendage_left",
     "heart_atrium heart_ventricle"},
    {"brain",
     "brain brainstem cerebellum thalamus caudate_nucleus lentiform_nucleus insular_cortex internal_capsule "
     "septum_pellucidum central_sulcus frontal_lobe parietal_lobe occipital_lobe temporal_lobe",
     ""},
    {"gland", "thyroid_gland pancreas prostate breast", "adrenal_gland parotid_gland submandibular_gland"},
    {"tumour", "liver_tumor liver_lesions lung_nodules", ""},
    {"hollow",
     "trachea lung_airways lung_trachea_bronchia pharynx nasopharynx oropharynx hypopharynx larynx_air "
     "sinus_maxillary sinus_frontal left_maxillary_sinus right_maxillary_sinus pleural_effusion "
     "pericardial_effusion subarachnoid_space third_ventricle fourth_ventricle",
     "kidney_cyst nasal_cavity auditory_canal ventricle_frontal_horn ventricle_occipital_horn "
     "ventricle_temporal_horn ventricle_body ventricle_trigone"},
    // "ventricle" alone is ambiguous between heart and brain, "annulus" between valve and disc
    {"unknown",
     "stomach esophagus duodenum small_bowel colon gallbladder urinary_bladder lung_airways_wall spinal_cord "
     "pericardium mediastinum thoracic_cavity abdominal_cavity body_trunc body_extremities head face "
     "ventricle "
     "annulus annulus_proper pul_annulus intracerebral_hemorrhage hip_implant implant bridge crown",
     "eye eyeball eye_lens"}};

std::map<std::string, std::string> totalsegmentator_tissues() {
  std::map<std::string, std::string> tissues;
  const auto add = [&](const std::string& name, const std::string& tissue) {
    EXPECT_TRUE(tissues.emplace(name, tissue).second) << name;
  };
  for (const Row& row : kRows) {
    std::istringstream single(row.names), paired(row.paired);
    for (std::string name; single >> name;) add(name, row.tissue);
    for (std::string name; paired >> name;)
      for (const char* side : {"_left", "_right"}) add(name + side, row.tissue);
  }
  for (int rib = 1; rib <= 12; ++rib)
    for (const char* side : {"left_", "right_"}) add("rib_" + (side + std::to_string(rib)), "bone");
  for (const auto& [region, count] : {std::pair('C', 7), {'T', 12}, {'L', 6}, {'S', 1}})
    for (int n = 1; n <= count; ++n) add("vertebrae_" + (region + std::to_string(n)), "bone");
  for (int segment = 1; segment <= 8; ++segment) add("liver_segment_" + std::to_string(segment), "liver");
  constexpr const char* kTeeth[] = {"central_incisor", "lateral_incisor", "canine",       "first_premolar",
                                    "second_premolar", "first_molar",     "second_molar", "third_molar"};
  constexpr const char* kQuadrants[] = {"upper_right_", "upper_left_", "lower_left_", "lower_right_"};
  for (int quadrant = 0; quadrant < 4; ++quadrant)
    for (int tooth = 0; tooth < 8; ++tooth) {
      const std::string name = std::string(kQuadrants[quadrant]) + kTeeth[tooth];
      const std::string number = std::to_string(quadrant + 1) + std::to_string(tooth + 1);
      add(name + "_fdi" + number, "bone");
      // nerves and vessels in loose connective tissue
      add(name + "_pulp_fdi1" + number, "nerve");
    }
  return tissues;
}

TEST(TotalSegmentatorNames, SuggestTheAnatomicalTissue) {
  const auto tissues = totalsegmentator_tissues();
  ASSERT_EQ(tissues.size(), 428u);
  int unknown = 0;
  for (const auto& [name, tissue] : tissues) {
    const PresetMatch match = match_preset(name);
    EXPECT_EQ(match.preset      ? match.preset->name
              : match.is_hollow ? "hollow"
                                : "unknown",
              tissue)
        << name << " by " << match.term;
    unknown += tissue == "unknown";
  }
  EXPECT_LE(unknown, 40);
}

TEST(TotalSegmentatorNames, KeepTheirSpelling) {
  for (const auto& [name, tissue] : totalsegmentator_tissues()) EXPECT_EQ(structure_in_name(name), name);
}

}  // namespace
}  // namespace palpate
