#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string_view>
#include <tuple>

#include "palpate/scene/scene.h"
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

std::vector<TissuePreset> make_presets() {
  // equilibrium modulus of cartilage: E = H_A (1 + nu)(1 - 2 nu)/(1 - nu) with nu = 0.1
  const double cartilage_MPa = 0.79 * 1.1 * 0.8 / 0.9;
  std::vector<TissuePreset> presets;
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
  return presets;
}

// ---- elastic constants -------------------------------------------------------------------------

/// Elastic constants of a preset. Presets without an entry (bone) are rigid.
struct ElasticPreset {
  std::string_view preset;
  ElasticConstants constants;
  std::array<double, 2> range_kPa;
  std::string_view source;
  /// Range of ElasticConstants::stiffening and its source; empty: not known to stiffen.
  std::array<double, 2> stiffening_range{};
  std::string_view stiffening_source = {};
};
constexpr std::string_view kAsLiver = "(E): the exponent of liver, whose parenchyma and capsule are alike";
// E is from the source of the stiffness, to two digits, unless noted otherwise
constexpr std::array kElasticPresets{
    ElasticPreset{"cartilage",
                  {770, 0.1},
                  {480, 1580},
                  "at equilibrium; range from H_A of 0.48 to 1.58 MPa at five sites of a tibia, with nu 0 to "
                  "0.05 (PMC2858459). Under fast loading it is several times stiffer"},
    ElasticPreset{"meniscus",
                  {120, 0},
                  {100, 160},
                  "at equilibrium, across its fibres; range from the means of its parts, same source. Along "
                  "them it is up to a thousand times stiffer, which an isotropic body cannot represent"},
    ElasticPreset{"disc", {990, 0.1}, {500, 2000}, "at equilibrium; range (E)"},
    ElasticPreset{
        "ligament",
        {96, 0.45},
        {75, 120},
        "across its fibres, the direction of palpation; range from mu of 25 to 39 kPa, same source. Along "
        "them it is stiffer by orders of magnitude (tangent modulus of the medial collateral ligament 332 "
        "MPa; "
        "Quapp, Weiss 1998, J Biomech Eng 120:757), which an isotropic body cannot represent"},
    ElasticPreset{
        "muscle",
        {14, 0.45},
        {5, 19},
        "3.9 to 6.2 kPa of shear modulus; from 5 kPa on (E). A linear body of 18 kPa describes 213 "
        "probes of meat within 1.5 %, so that it has no stiffening ([outside](../results/outside.md))"},
    ElasticPreset{"fat", {9.1, 0.45}, {1, 25}, "range (E)"},
    ElasticPreset{
        "skin",
        {130, 0.45},
        {41, 220},
        "range: one standard deviation, same source. Skin of the breast by suction 56 kPa (Briot et "
        "al. 2022, Clin Biomech 99:105743)"},
    ElasticPreset{"vessel",
                  {12, 0.45},
                  {6, 24},
                  "(E) of a solid body that deforms as much under the probe as the tube does. Labels include "
                  "the blood, and the wall's 771 kPa would be far too stiff"},
    ElasticPreset{
        "nerve",
        {39, 0.45, 1.5},
        {19, 77},
        "range (E)",
        {0, 2.3},
        "alpha = 6.5 of the same source, by equal energy in simple shear of 0.6; range: in compression "
        "and in tension by 30 to 40 %"},
    ElasticPreset{
        "liver",
        {6.3, 0.45, 15},
        {5.4, 6.3},
        "range from a shear modulus of 1.8 kPa elsewhere (doi 10.1088/1361-6560/ab5010)",
        {15, 50},
        "418 probes of pig liver with a sphere of 4 mm, whose force grows e-fold per mm "
        "([outside](../results/outside.md)). 15 with E of 5.4 kPa on a plate at 15 mm, 50 with 3 kPa at "
        "25 mm: the thickness was not recorded"},
    ElasticPreset{
        "kidney",
        {5, 0.45, 15},
        {2.5, 15},
        "to a shear modulus of 4.9 kPa by MR elastography at 45 Hz (Rouviere et al. 2011, J Magn Reson "
        "Imaging 34:880); from (E)",
        {0, 50},
        kAsLiver},
    ElasticPreset{"spleen",
                  {2.9, 0.45, 15},
                  {1.5, 11},
                  "to a shear stiffness of 3.565 kPa by MR elastography at 60 Hz (Mannelli et al. 2010, AJR "
                  "195:387); from (E)",
                  {0, 50},
                  kAsLiver},
    ElasticPreset{"lung", {3.4, 0.4}, {1.7, 7}, "range (E); nu (E), lower than elsewhere because of the air"},
    ElasticPreset{"heart", {3.4, 0.45}, {1.7, 7}, "at rest; range (E)"},
    ElasticPreset{"brain", {1.9, 0.45}, {1.5, 4.5}, "range (E), from shear moduli of 0.5 to 1.5 kPa"},
    ElasticPreset{"gland", {11, 0.45}, {4.8, 11}, "range: pancreas to submandibular gland, same source"},
    ElasticPreset{"lymph node", {21, 0.45}, {10, 43}, "range (E)"},
    ElasticPreset{"tumour",
                  {43, 0.45},
                  {43, 69},
                  "range from a shear modulus of 23 kPa of liver cancer (doi 10.1088/1361-6560/ab5010)"}};

/// Relaxation of a preset, where measured. Slow measurements give no instantaneous part.
struct RelaxationPreset {
  std::string_view preset;
  Relaxation relaxation;
  std::string_view range, source;
};
// midpoints of both ranges; the geometric mean for times
constexpr Relaxation kLimb{{{{0.15, 0.7}, {}}}};
constexpr std::string_view kLimbRange = "fraction 0.03 … 0.28, time 0.05 … 8.9 s";
constexpr std::array kRelaxationPresets{
    RelaxationPreset{
        "muscle", kLimb, kLimbRange,
        "Zheng, Mak 1999, J Biomech Eng 121:330. Indentation of the lower limb in vivo, skin, fat "
        "and muscle together, eight subjects, four sites, three postures. Pig's muscle by itself "
        "lost half when it was compressed (Van Loocke, Lyons, Simms 2008, J Biomech 41:1555)"},
    RelaxationPreset{"fat", kLimb, kLimbRange, "the same limbs"},
    RelaxationPreset{"skin", kLimb, kLimbRange,
                     "the same limbs. Skin of mice by itself lost 0.53 to 0.72 in 0.2 to 1.9 s when it was "
                     "compressed (Wang et al. 2015, PLoS ONE 10:e0120897)"}};

const ElasticPreset* elastic_preset(std::string_view preset) {
  const auto found = std::find_if(kElasticPresets.begin(), kElasticPresets.end(),
                                  [&](const ElasticPreset& elastic) { return elastic.preset == preset; });
  return found == kElasticPresets.end() ? nullptr : &*found;
}

// ---- matching -----------------------------------------------------------------------------------

bool is_upper(char c) {
  return c >= 'A' && c <= 'Z';
}
bool is_letter(char c) {
  return is_upper(c) || (c >= 'a' && c <= 'z');
}

/// Splits a name into runs of letters in lower case; "LeftFemur2" gives "left", "femur".
std::vector<std::string> words_of(const std::string& name) {
  std::vector<std::string> words;
  char before = ' ';
  for (const char c : name) {
    if (is_letter(c)) {
      if (!is_letter(before) || (is_upper(c) && !is_upper(before))) words.emplace_back();
      words.back() += static_cast<char>(is_upper(c) ? c - 'A' + 'a' : c);
    }
    before = c;
  }
  return words;
}

// Contents that are not tissue and do not resist, regardless of the structure they are in.
const std::vector<std::string> kHollowContents{"cyst", "fluid", "effusion", "lumen", "air", "gas", "csf"};
// Cavities that hold air or fluid.
const std::vector<std::string> kHollowStructures{"airway",
                                                 "trachea",
                                                 "bronchus",
                                                 "bronchi",
                                                 "bronchia",
                                                 "pharynx",
                                                 "nasopharynx",
                                                 "oropharynx",
                                                 "hypopharynx",
                                                 "nasal cavity",
                                                 "auditory canal",
                                                 "ear canal",
                                                 "maxillary sinus",
                                                 "sinus maxillary",
                                                 "frontal sinus",
                                                 "sinus frontal",
                                                 "sphenoid sinus",
                                                 "ethmoid sinus",
                                                 "paranasal sinus",
                                                 "lateral ventricle",
                                                 "third ventricle",
                                                 "fourth ventricle",
                                                 "ventricle frontal horn",
                                                 "ventricle occipital horn",
                                                 "ventricle temporal horn",
                                                 "ventricle body",
                                                 "ventricle trigone",
                                                 "subarachnoid space"};
// Solid contents without a sourced preset, regardless of the structure they are in.
const std::vector<std::string> kForeignContents{"implant",  "prosthesis", "endoprosthesis",
                                                "stent",    "hemorrhage", "haemorrhage",
                                                "hematoma", "haematoma",  "thrombus"};
// Tissues that would otherwise match the cavity they enclose.
const std::vector<std::string> kUnsourcedStructures{"airway wall"};

/// Precedence of a term, ascending: enclosing structure, kind of tissue, contents.
enum class TermRank { kStructure, kKind, kContent };

struct Term {
  std::string text;
  std::vector<std::string> words;
  TermRank rank;
  const TissuePreset* preset;  ///< Preset; null: none
  bool is_hollow;
};

std::vector<Term> make_terms() {
  std::vector<Term> terms;
  const auto add = [&](const std::vector<std::string>& texts, TermRank rank, const TissuePreset* preset,
                       bool is_hollow) {
    for (const std::string& text : texts) terms.push_back({text, words_of(text), rank, preset, is_hollow});
  };
  for (const TissuePreset& preset : tissue_presets()) {
    add(preset.kind_words, TermRank::kKind, &preset, false);
    add(preset.structure_names, TermRank::kStructure, &preset, false);
  }
  add(kHollowContents, TermRank::kContent, nullptr, true);
  add(kForeignContents, TermRank::kContent, nullptr, false);
  add(kHollowStructures, TermRank::kStructure, nullptr, true);
  add(kUnsourcedStructures, TermRank::kStructure, nullptr, false);
  return terms;
}

/// A match of a term in a name: words [begin, end).
struct TermMatch {
  const Term* term;
  std::size_t begin, end;

  bool is_within(const TermMatch& other) const {
    return other.begin <= begin && end <= other.end && other.end - other.begin > end - begin;
  }
  auto precedence() const { return std::tuple(term->rank, end, end - begin); }
};

std::vector<TermMatch> find_terms(const std::vector<std::string>& words) {
  static const std::vector<Term> terms = make_terms();
  const auto is_same = [](const std::string& word, const std::string& of_term) {
    return word == of_term || word == of_term + "s";
  };
  std::vector<TermMatch> matches;
  for (const Term& term : terms)
    for (std::size_t n = 0; n + term.words.size() <= words.size(); ++n)
      if (std::equal(
              term.words.begin(), term.words.end(), words.begin() + static_cast<std::ptrdiff_t>(n),
              [&](const std::string& of_term, const std::string& word) { return is_same(word, of_term); }))
        matches.push_back({&term, n, n + term.words.size()});
  return matches;
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
    for (const RelaxationPreset& one : kRelaxationPresets)
      for (TissuePreset& preset : made)
        if (preset.name == one.preset) preset.values.relaxation = one.relaxation;
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

PresetMatch match_preset(const std::string& structure_name) {
  const std::vector<TermMatch> matches = find_terms(words_of(structure_name));
  const TermMatch* best = nullptr;
  for (const TermMatch& match : matches) {
    // a word counts only in the longest term that contains it: the thyroid of "sterno thyroid" is not a gland
    if (std::ranges::any_of(matches, [&](const TermMatch& other) { return match.is_within(other); }))
      continue;
    if (!best || match.precedence() > best->precedence()) best = &match;
  }
  if (!best) return {};
  return {best->term->preset, best->term->text, best->term->is_hollow};
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

std::string elastic_preset_table() {
  std::string text =
      "| preset | E kPa | nu | range of E kPa | from | stiffening | its range | from |\n"
      "|---|---|---|---|---|---|---|---|\n";
  for (const TissuePreset& preset : tissue_presets()) {
    const ElasticPreset* elastic = elastic_preset(preset.name);
    if (elastic == nullptr) {
      text += "| `" + preset.name + "` | — | — | — | does not yield | — | — | |\n";
      continue;
    }
    const auto& [low_kPa, high_kPa] = elastic->range_kPa;
    text += "| `" + preset.name + "` | " + number_text(elastic->constants.youngs_modulus_kPa) + " | " +
            number_text(elastic->constants.poissons_ratio) + " | " + number_text(low_kPa) + " … " +
            number_text(high_kPa) + " | " + std::string(elastic->source) + " | " +
            number_text(elastic->constants.stiffening);
    const auto& [low, high] = elastic->stiffening_range;
    text += elastic->stiffening_source.empty() ? " | — | |\n"
                                               : " | " + number_text(low) + " … " + number_text(high) +
                                                     " | " + std::string(elastic->stiffening_source) + " |\n";
  }
  return text;
}

std::string relaxation_preset_table() {
  std::string text = "| preset | relaxation | range | from |\n|---|---|---|---|\n";
  for (const RelaxationPreset& preset : kRelaxationPresets) {
    text += "| `" + std::string(preset.preset) + "` | `[";
    for (const RelaxationTerm& term : preset.relaxation.term)
      if (term.fraction > 0)
        text += (text.back() == '[' ? "[" : ", [") + number_text(term.fraction) + ", " +
                number_text(term.time_s) + "]";
    text += "]` | " + std::string(preset.range) + " | " + std::string(preset.source) + " |\n";
  }
  return text;
}

}  // namespace palpate
