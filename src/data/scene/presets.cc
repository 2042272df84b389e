#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string_view>

#include "palpate/scene/scene.h"
#include "palpate/scene/tissue_presets.h"
#include "scene/elastic_presets.h"
#include "scene/keys.h"

namespace palpate {
namespace {

// radius of a blunt probe, modelled as a flat punch
constexpr double kProbeRadius_mm = 1.5;
// series stiffness that represents the device: a Premium 1.5 at 1 kHz with 1 ms latency becomes unstable at
// 1.9 N/mm in a light grip (simulated plant); this leaves a margin of a fifth
constexpr double kDeviceStiffness_N_per_mm = 1.5;

/// Contact stiffness of a flat punch on a half-space: K = 2 a E / (1 - nu^2) (Sneddon 1965).
double punch_stiffness(double modulus_MPa, double poisson) {
  return 2 * kProbeRadius_mm * modulus_MPa / (1 - poisson * poisson);
}

/// Stiffness of a tube compressed across its diameter: K = E I / (0.149 R^3), I = b t^3 / 12 (Roark's ring
/// under two opposite loads), over the width of the probe.
double tube_stiffness(double modulus_MPa, double radius_mm, double wall_mm) {
  const double second_moment = 2 * kProbeRadius_mm * wall_mm * wall_mm * wall_mm / 12;
  return modulus_MPa * second_moment / (0.149 * radius_mm * radius_mm * radius_mm);
}

/// Stiffness rendered through the device's series spring, rounded to 0.01 N/mm, or to 0.001 N/mm below 0.1.
/// It preserves the order of tissues, changes soft ones little and never exceeds the device's stiffness.
double coupled_stiffness(double tissue_N_per_mm) {
  const double stiffness_N_per_mm =
      tissue_N_per_mm * kDeviceStiffness_N_per_mm / (tissue_N_per_mm + kDeviceStiffness_N_per_mm);
  const double steps = stiffness_N_per_mm < 0.1 ? 1000 : 100;
  return std::round(stiffness_N_per_mm * steps) / steps;
}

struct Surface {
  double friction, damping_N_s_per_mm, max_N, viscosity_N_s_per_mm;
};

TissuePreset make(std::string name, double tissue_N_per_mm, const Surface& surface, double opacity,
                  const Rgb& colour, const std::string& source, std::vector<std::string> kind_words,
                  std::vector<std::string> structure_names) {
  TissuePreset preset;
  preset.values.preset = name;
  preset.values.stiffness_N_per_mm = coupled_stiffness(tissue_N_per_mm);
  preset.values.friction = surface.friction;
  preset.values.friction_damping_N_s_per_mm = surface.damping_N_s_per_mm;
  preset.values.friction_max_N = surface.max_N;
  preset.values.viscosity_N_s_per_mm = surface.viscosity_N_s_per_mm;
  preset.values.opacity = opacity;
  preset.values.colour = colour;
  std::array<char, 64> stiffness{};
  std::snprintf(stiffness.data(), stiffness.size(), ". Under the probe %.3g N/mm", tissue_N_per_mm);
  preset.source = source + stiffness.data();
  preset.name = std::move(name);
  preset.kind_words = std::move(kind_words);
  preset.structure_names = std::move(structure_names);
  return preset;
}

void add_bone(std::vector<TissuePreset>& presets) {
  presets.push_back(
      make("bone", punch_stiffness(18600, 0.3), {0.2, 0.005, 0.5, 0.001}, 1, {227, 218, 201},
           "Rho, Ashman, Turner 1993, J Biomech 26:111. Cortical bone of the human tibia, E = 18.6 GPa by "
           "microtensile test; nu = 0.3",
           {"bone", "bony", "trabecular", "osseous", "vertebral body"},
           {"femur",
            "tibia",
            "fibula",
            "patella",
            "rib",
            "ribs",
            "vertebra",
            "vertebrae",
            "sacrum",
            "coccyx",
            "hip",
            "pelvis",
            "ilium",
            "ischium",
            "pubis",
            "scapula",
            "clavicula",
            "clavicle",
            "humerus",
            "ulna",
            "radius",
            "skull",
            "cranium",
            "mandible",
            "maxilla",
            "sternum",
            "carpal",
            "carpus",
            "metacarpal",
            "tarsal",
            "tarsus",
            "metatarsal",
            "phalanx",
            "phalanges",
            "talus",
            "calcaneus",
            "navicular",
            "cuboid",
            "cuneiform",
            "acetabulum",
            "fabella",
            "sesamoid",
            "spine",
            "hyoid",
            "jaw",
            "jawbone",
            "tooth",
            "teeth",
            "zygoma",
            "zygomatic",
            "vomer",
            "ethmoid",
            "sphenoid",
            "cortical",
            "scaphoid",
            "lunate",
            "triquetrum",
            "pisiform",
            "trapezium",
            "trapezoid",
            "capitate",
            "hamate",
            "costa",
            "costae",
            "hipbone",
            "collarbone",
            "kneecap",
            "shinbone",
            "heel bone",
            "incisor",
            "malleus",
            "incus",
            "stapes",
            "ossicle",
            "ossicles",
            "condyle",
            "condylar process",
            "canine",
            "premolar",
            "molar",
            "hard palate",
            "styloid process"}));
}

void add_cartilage_and_ligaments(std::vector<TissuePreset>& presets) {
  // equilibrium modulus of cartilage: E = H_A (1 + nu)(1 - 2 nu)/(1 - nu) with nu = 0.1
  const double cartilage_MPa = 0.79 * 1.1 * 0.8 / 0.9;
  presets.push_back(
      make("cartilage", punch_stiffness(cartilage_MPa, 0.1), {0.025, 0.002, 0.1, 0.001}, 1, {196, 218, 232},
           "Armstrong, Mow 1982, J Bone Joint Surg Am 64:88. Human patellar cartilage, mean aggregate "
           "modulus 0.79 MPa at equilibrium; nu = 0.1, E = 0.77 MPa",
           {"cartilage", "cartilago", "chondral"}, {"labrum"}));
  presets.back().source +=
      ". Friction: Bonnevie et al. 2011, Tribol Lett 41:83: 0.025 under a probe that slides at 1 to 5 mm/s";
  presets.push_back(
      make("meniscus", punch_stiffness(0.12, 0), {0.05, 0.002, 0.2, 0.001}, 1, {232, 222, 160},
           "Sweigart et al. 2004, Ann Biomed Eng 32:1569. Human medial meniscus, aggregate modulus "
           "0.16 MPa in front, 0.10 MPa in the middle and behind; their mean 0.12 MPa, nu = 0",
           {"meniscus", "menisci", "meniscal"}, {}));
  // E = H_A (1 + nu)(1 - 2 nu)/(1 - nu), as for cartilage
  const double disc_MPa = 1.01 * 1.1 * 0.8 / 0.9;
  presets.push_back(
      make("disc", punch_stiffness(disc_MPa, 0.1), {0.05, 0.002, 0.2, 0.001}, 1, {160, 190, 182},
           "Johannessen, Elliott 2005, Spine 30:E724. Nucleus of human lumbar discs that are not degenerate, "
           "effective aggregate modulus 1.01 MPa; nu = 0.1, E = 0.99 MPa",
           {"intervertebral disc", "intervertebral disk", "disc", "disk", "discus"},
           {"annulus fibrosus", "nucleus pulposus"}));
  presets.push_back(
      make("ligament", punch_stiffness(3 * 0.032, 0.5), {0.1, 0.003, 0.3, 0.001}, 1, {214, 182, 140},
           "Main et al. 2011, J Biomech 44:863. Human tendon compressed across its fibres, the direction of "
           "palpation, first-order Ogden mu = 25 to 39 kPa, taken 32 kPa; E = 3 mu, nu = 0.5",
           {"ligament", "ligamentum", "tendon", "tendo", "aponeurosis", "retinaculum", "fascia"},
           {"iliotibial tract", "iliotibial band", "acl", "pcl", "mcl", "lcl"}));
}

void add_muscle_fat_and_skin(std::vector<TissuePreset>& presets) {
  presets.push_back(make(
      "muscle", punch_stiffness(3 * 0.0045, 0.5), {0.1, 0.003, 0.2, 0.003}, 0.6, {172, 58, 52},
      "Chakouch, Charleux, Bensamoun 2015, PLoS ONE 10:e0138873. Nine human thigh muscles at rest, shear "
      "modulus 3.9 to 6.2 kPa; taken 4.5 kPa, E = 3 mu, nu = 0.5",
      {"muscle", "muscular", "musculus", "musculature"},
      {"gluteus", "autochthon", "iliopsoas", "psoas", "quadriceps", "sartorius", "gastrocnemius", "soleus",
       "gracilis", "semimembranosus", "semitendinosus", "deltoid", "trapezius", "pectoralis", "supraspinatus",
       "infraspinatus", "subscapularis", "masseter", "temporalis", "vastus", "rectus femoris",
       "rectus abdominis", "biceps", "triceps", "brachialis", "brachioradialis", "adductor magnus",
       "adductor longus", "adductor brevis", "pectineus", "popliteus", "plantaris", "tibialis anterior",
       "tibialis posterior", "peroneus", "piriformis", "obturator internus", "obturator externus", "iliacus",
       "quadratus lumborum", "quadratus femoris", "erector spinae", "multifidus", "latissimus dorsi",
       "rhomboid", "serratus", "teres major", "teres minor", "levator scapulae", "sternocleidomastoid",
       "scalene", "scalenus", "digastric", "mylohyoid", "geniohyoid", "pterygoid", "buccinator",
       "orbicularis", "platysma", "diaphragm", "hamstring", "tensor fasciae latae", "intercostal", "tongue",
       "pharyngeal constrictor", "levator palpebrae", "sternothyroid", "sterno thyroid", "thyrohyoid",
       "thyro hyoid", "sternohyoid", "sterno hyoid", "omohyoid", "stylohyoid", "prevertebral",
       "external oblique", "internal oblique", "superior oblique", "inferior oblique", "lateral rectus",
       "medial rectus", "superior rectus", "inferior rectus", "transversospinalis", "transversus abdominis",
       "coracobrachialis", "coracobrachial", "soft palate", "thigh medial compartment",
       "thigh posterior compartment", "thigh anterior compartment",
       // such a segment contains mostly what surrounds bone
       "soft tissue", "soft tissues"}));
  presets.push_back(
      make("fat", punch_stiffness(3 * 0.00304, 0.5), {0.05, 0.002, 0.1, 0.002}, 0.4, {244, 208, 104},
           "Chakouch, Charleux, Bensamoun 2015, PLoS ONE 10:e0138873. Fat under the skin of the human "
           "thigh, shear modulus 3.04 kPa; E = 3 mu, nu = 0.5",
           {"fat", "fatty", "adipose", "hoffa"}, {"omentum"}));
  presets.push_back(make(
      "skin", punch_stiffness(0.129, 0.5), {0.3, 0.003, 0.3, 0.001}, 0.4, {236, 188, 168},
      "Diridollou et al. 2000, Skin Res Technol 6:214. Skin of the forearm of ten men by suction in vivo, "
      "E = 129 kPa; nu = 0.5",
      {"skin", "dermis", "epidermis", "cutis", "scalp"}, {}));
}

void add_vessels_and_nerves(std::vector<TissuePreset>& presets) {
  presets.push_back(make(
      "vessel", tube_stiffness(0.771, 3, 1), {0.05, 0.002, 0.1, 0.001}, 1, {206, 22, 38},
      "Riley et al. 1992, Stroke 23:952. Wall of the human carotid artery, E = 771 kPa in men of 45 to 49 "
      "years. As a tube without pressure (tourniquet) of radius 3 mm and wall 1 mm",
      {"artery", "arteries", "arteria", "arteriole", "vein", "vena", "venae", "venous", "arterial", "vessel",
       "vascular", "choroid plexus"},
      {"aorta", "brachiocephalic trunk", "celiac trunk", "coeliac trunk", "pulmonary trunk", "vena cava",
       "saphenous", "carotid", "jugular", "aneurysm", "venous sinus", "venous sinuses", "true lumen",
       "false lumen",
       // root of an artery at its valve
       "sinotubular junction", "coronary cusp", "pul bifurcation", "pulmonary bifurcation", "pul left start",
       "pul right start"}));
  presets.push_back(
      make("nerve", punch_stiffness(3 * 0.0129, 0.5), {0.1, 0.003, 0.2, 0.001}, 1, {250, 238, 60},
           "Main et al. 2011, J Biomech 44:863. Human median nerve compressed across, first-order Ogden "
           "mu = 12.9 kPa, taken as the shear modulus at small strain; E = 3 mu, nu = 0.5",
           {"nerve", "nervus", "plexus", "optic disc"},
           {"sciatic", "optic chiasm",
            // canals of the jaw are classified by their contents, the pulp of a tooth as nerves and vessels
            "alveolar canal", "mandibular canal", "incisive canal", "lingual canal", "incisor pulp",
            "canine pulp", "premolar pulp", "molar pulp", "dental pulp", "tooth pulp"}));
}

void add_organs(std::vector<TissuePreset>& presets) {
  presets.push_back(
      make("liver", punch_stiffness(3 * 0.00209, 0.5), {0.05, 0.002, 0.1, 0.003}, 0.8, {118, 46, 34},
           "Venkatesh et al. 2014, J Magn Reson Imaging 39:1. Human liver by MR elastography at 60 Hz, shear "
           "stiffness 2.09 kPa; E = 3 mu, nu = 0.5",
           {}, {"liver", "hepatic", "hepar", "caudate lobe", "quadrate lobe"}));
  presets.push_back(make(
      "kidney", punch_stiffness(0.0050, 0.5), {0.05, 0.002, 0.1, 0.003}, 0.8, {156, 92, 70},
      "Arda et al. 2011, AJR 197:532. Renal cortex of volunteers by shear wave elastography, E = 5.0 kPa; "
      "nu = 0.5",
      {}, {"kidney", "renal"}));
  presets.push_back(
      make("spleen", punch_stiffness(0.0029, 0.5), {0.05, 0.002, 0.1, 0.003}, 0.8, {112, 40, 78},
           "Arda et al. 2011, AJR 197:532. Spleen of volunteers by shear wave elastography, E = 2.9 kPa; "
           "nu = 0.5",
           {}, {"spleen", "splenic", "lien"}));
  presets.push_back(
      make("lung", punch_stiffness(3 * 0.00114, 0.5), {0.05, 0.002, 0.1, 0.001}, 0.4, {240, 158, 168},
           "Mariappan et al. 2011, J Magn Reson Imaging 33:1351. Human lung by MR elastography, shear "
           "stiffness 1.14 kPa at residual volume; E = 3 mu, nu = 0.5",
           {}, {"lung", "pulmo"}));
  presets.push_back(
      make("heart", punch_stiffness(0.0034, 0.5), {0.05, 0.002, 0.1, 0.003}, 0.8, {202, 88, 92},
           "Wen et al. 2005, Magn Reson Med 54:538. Lateral wall of the left ventricle of dogs in diastole, "
           "E = 3.40 kPa by MRI; nu = 0.5",
           {"myocardium", "myocardial"},
           {"heart", "cardiac", "atrium", "atrial appendage", "left ventricle", "right ventricle",
            "ventricular outflow tract"}));
  presets.push_back(
      make("brain", punch_stiffness(0.001895, 0.5), {0.05, 0.002, 0.1, 0.003}, 0.8, {200, 166, 182},
           "Budday et al. 2015, J Mech Behav Biomed Mater 46:318. Bovine white matter under a flat punch, "
           "E = 1.895 kPa; nu = 0.5",
           {"white matter", "gray matter", "grey matter"},
           {"brain",
            "cerebrum",
            "cerebral",
            "cerebellum",
            "cerebellar",
            "brainstem",
            "thalamus",
            "hypothalamus",
            "hippocampus",
            "amygdala",
            "putamen",
            "pallidum",
            "caudate nucleus",
            "caudate",
            "accumbens",
            "midbrain",
            "medulla oblongata",
            "corpus callosum",
            "gyrus",
            "ctx",
            "frontal lobe",
            "parietal lobe",
            "temporal lobe",
            "occipital lobe",
            "insular cortex",
            "lentiform nucleus",
            "internal capsule",
            "septum pellucidum",
            "central sulcus"}));
}

void add_glands_and_tumours(std::vector<TissuePreset>& presets) {
  presets.push_back(
      make("gland", punch_stiffness(0.01092, 0.5), {0.05, 0.002, 0.1, 0.003}, 0.8, {226, 148, 92},
           "Arda et al. 2011, AJR 197:532. Submandibular glands of volunteers by shear wave elastography, "
           "E = 10.92 kPa (parotid 10.38, thyroid 10.97, pancreas 4.8); nu = 0.5",
           {"gland", "glandula", "glandular"},
           {"thyroid", "parathyroid", "parotid", "submandibular", "sublingual", "salivary", "adrenal",
            "pituitary", "hypophysis", "prostate", "pancreas", "thymus", "breast", "mammary", "testis"}));
  presets.push_back(
      make("lymph node", punch_stiffness(0.0214, 0.5), {0.05, 0.002, 0.1, 0.002}, 1, {142, 150, 84},
           "Bhatia et al. 2012, Ultrasound Med Biol 38:195. Benign human cervical lymph nodes by shear wave "
           "elastography, median E = 21.4 kPa; nu = 0.5",
           {"lymph node", "lymphnode", "lymphonodus"}, {"tonsil"}));
  presets.push_back(make(
      "tumour", punch_stiffness(0.04252, 0.5), {0.1, 0.003, 0.2, 0.002}, 1, {178, 132, 32},
      "Samani, Zubovits, Plewes 2007, Phys Med Biol 52:1565. High-grade invasive ductal carcinoma of the "
      "human breast, E = 42.52 kPa; nu = 0.5",
      {"tumour", "tumor", "lesion", "carcinoma", "cancer", "metastasis", "metastases", "neoplasm", "nodule",
       "adenoma", "fibroadenoma", "sarcoma", "glioma", "meningioma", "lymphoma", "gtv"},
      {}));
}

std::vector<TissuePreset> make_presets() {
  std::vector<TissuePreset> presets;
  add_bone(presets);
  add_cartilage_and_ligaments(presets);
  add_muscle_fat_and_skin(presets);
  add_vessels_and_nerves(presets);
  add_organs(presets);
  add_glands_and_tumours(presets);
  return presets;
}

std::string hex_text(const Rgb& colour) {
  std::array<char, 8> text{};
  std::snprintf(text.data(), text.size(), "#%02x%02x%02x", colour.r, colour.g, colour.b);
  return text.data();
}

}  // namespace

const std::vector<TissuePreset>& tissue_presets() {
  static const std::vector<TissuePreset> presets = [] {
    std::vector<TissuePreset> made = make_presets();
    for (TissuePreset& preset : made)
      if (const ElasticPreset* elastic = elastic_preset(preset.name)) {
        preset.values.elastic = elastic->constants;
        preset.range_kPa = elastic->range_kPa;
      }
    for (TissuePreset& preset : made)
      if (const Relaxation* relaxation = measured_relaxation(preset.name))
        preset.values.relaxation = *relaxation;
    return made;
  }();
  return presets;
}

const TissuePreset* find_preset(std::string_view name) {
  const auto& presets = tissue_presets();
  const auto found =
      std::find_if(presets.begin(), presets.end(), [&](const auto& preset) { return preset.name == name; });
  return found == presets.end() ? nullptr : &*found;
}

std::string tissue_preset_table() {
  std::string text =
      "| preset | stiffness N/mm | friction | friction_damping N·s/mm | friction_max N | viscosity N·s/mm | "
      "opacity | colour | source |\n|---|---|---|---|---|---|---|---|---|\n";
  for (const TissuePreset& preset : tissue_presets()) {
    const TissueSettings& v = preset.values;
    text += "| `" + preset.name + "`";
    for (const double value : {v.stiffness_N_per_mm, v.friction, v.friction_damping_N_s_per_mm,
                               v.friction_max_N, v.viscosity_N_s_per_mm, v.opacity})
      text += " | " + number_text(value);
    text += " | `" + hex_text(*v.colour) + "` | " + preset.source + " |\n";
  }
  return text;
}

}  // namespace palpate
