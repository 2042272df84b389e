#include "volume_io/labels/anatomy_words.h"

#include <algorithm>
#include <array>
#include <set>
#include <vector>

#include "volume_io/labels/label_text.h"

namespace palpate::volume_io {
namespace {

// words that by themselves name a structure or a kind of tissue
constexpr std::string_view kStructures =
    // bone and joints
    "bone bony osseous trabecular cortical cancellous femur femoral tibia tibial fibula fibular patella "
    "patellar rib costae costal vertebra vertebrae vertebral sacrum sacral coccyx hip pelvis pelvic "
    "ilium ischium pubis scapula scapular scapulae clavicula clavicle humerus humeral ulna ulnar radius "
    "radial skull cranium cranial mandible mandibular maxilla maxillary sternum sternal carpal carpus "
    "metacarpal tarsal tarsus metatarsal phalanx phalange phalanges talus calcaneus navicular cuboid "
    "cuneiform acetabulum acetabular fabella sesamoid spine spinal hyoid jaw jawbone tooth teeth zygoma "
    "malleus incus stapes ossicle ossicles condylar "
    "zygomatic zygomaticus vomer ethmoid sphenoid scaphoid lunate triquetrum pisiform trapezium trapezoid "
    "alveolar incisive styloid canal pulp dental capitate hamate hipbone collarbone kneecap shinbone heel "
    "knee "
    "ankle elbow shoulder wrist thorax "
    "thoracic lumbar cervical atlas condyle trochlea trochlear plateau incisor canine premolar molar "
    "cartilage cartilago chondral labrum meniscus menisci meniscal disc disk discus intervertebral annulus "
    "anulus fibrosus nucleus pulposus ligament ligamentum tendon tendo aponeurosis retinaculum fascia "
    "fasciae iliotibial acl pcl mcl lcl cruciate collateral "
    // muscle
    "muscle muscular musculus musculature gluteus autochthon iliopsoas psoas quadriceps sartorius "
    "gastrocnemius soleus gracilis semimembranosus semitendinosus deltoid trapezius pectoralis "
    "supraspinatus infraspinatus subscapularis masseter temporalis vastus rectus femoris abdominis biceps "
    "triceps brachialis brachioradialis adductor pectineus popliteus plantaris tibialis peroneus piriformis "
    "obturator iliacus quadratus lumborum erector spinae multifidus latissimus dorsi rhomboid serratus "
    "teres levator sternocleidomastoid scalene scalenus digastric mylohyoid geniohyoid pterygoid buccinator "
    "orbicularis platysma diaphragm hamstring tensor latae intercostal tongue sphincter constrictor thigh "
    "calf coracobrachialis coracobrachial prevertebral thyrohyoid sterno transversospinalis "
    "palpebrae intermuscular sternothyroid sternohyoid omohyoid stylohyoid thyro transversus "
    // fat, skin, vessels, nerves
    "fat fatty adipose omentum torso subcutaneous skin dermis epidermis cutis scalp artery arteries "
    "arteria arteriole vein veins vena venae venous arterial vessel vascular choroid plexus aorta aortic "
    "brachiocephalic celiac coeliac cava saphenous carotid jugular subclavian iliac iliaca portal coronary "
    "pulmonary pul sinotubular cusp mesenteric nerve nervus sciatic optic chiasm "
    // organs and glands
    "liver hepatic hepar kidney renal spleen splenic lung pulmo heart cardiac atrium atrial ventricle "
    "ventricular appendage myocardium myocardial pericardium trachea bronchus bronchi bronchial "
    "bronchie bronchia pleural pericardial mediastinum septum pellucidum airway esophagus oesophagus stomach "
    "gastric duodenum bowel intestine colon rectum rectal "
    "caecum cecum appendix jejunum ileum mesentery gallbladder biliary bladder urinary urethra ureter "
    "uterus uterine ovary ovarian vagina penis bulb prostate testis scrotum thyroid parathyroid parotid "
    "submandibular sublingual salivary adrenal pituitary hypophysis pancreas pancreatic thymus breast "
    "mammary gland glandula glandular lymph node lymphnode lymphonodus tonsil pharynx larynx laryngeal "
    "pharyngeal auditory epiglottis glottis hypopharynx oropharynx nasopharynx arytenoid cricoid "
    "cricopharyngeus eye eyeball "
    "lens cornea retina cochlea ear nose nasal sinus mouth cavity palate lips lip brachial thoracica "
    // brain, as FreeSurfer and others name it
    "brain cerebrum cerebral cerebellum cerebellar brainstem thalamus hypothalamus hippocampus hippocampal "
    "amygdala putamen pallidum caudate accumbens midbrain medulla oblongata corpus callosum gyrus ctx "
    "cortex matter csf ventraldc hypointensities pial wm gm dura lobe frontal parietal temporal "
    "occipital cingulate insula cuneus precuneus entorhinal fusiform lingual parahippocampal paracentral "
    "opercularis orbitalis triangularis pericalcarine postcentral precentral supramarginal orbitofrontal "
    "bankssts caudalanteriorcingulate caudalmiddlefrontal inferiorparietal inferiortemporal "
    "isthmuscingulate lateraloccipital lateralorbitofrontal medialorbitofrontal middletemporal "
    "parsopercularis parsorbitalis parstriangularis posteriorcingulate rostralanteriorcingulate "
    "rostralmiddlefrontal superiorfrontal superiorparietal superiortemporal frontalpole temporalpole "
    "transversetemporal insular lentiform sulcus trigone subarachnoid sinuses intracerebral substantia nigra "
    "fornix tectum vermis myelum "
    // pathologies and cavities
    "tumour tumor lesion carcinoma cancer metastasis metastases neoplasm nodule adenoma fibroadenoma "
    "sarcoma glioma meningioma lymphoma gtv ctv ptv cyst effusion lumen aneurysm thrombus hematoma edema "
    "oedema necrosis infarct plaque calcification hemorrhage haemorrhage infiltrate";

// position, shape and number: name no structure by themselves
constexpr std::string_view kQualities =
    "left right lt rt lh rh dex sinister dexter bilateral anterior posterior medial lateral superior "
    "inferior upper lower middle proximal distal central deep superficial internal external interior "
    "exterior interna externa internus externus ventral dorsal rostral caudal subcortical lateralis medialis "
    "intermedius "
    "longus brevis and of the tissue body head neck tail shaft trunk "
    "trunc tract muscles part pars isthmus quadrate inf sup lat vent ant proper soft fluid "
    "air gas choroidplexus extremities capsule skeletal abdominal bifurcation brachii compartment junction "
    "outflow process superioris covid first second third fourth fdi";

// Words that are also family names, with the word that must precede or follow them.
struct CompanionWord {
  std::string_view word, before, after;
};
constexpr std::array kCompanionWords{
    CompanionWord{"white", "", "matter"},      CompanionWord{"gray", "", "matter"},
    CompanionWord{"grey", "", "matter"},       CompanionWord{"small", "", "bowel"},
    CompanionWord{"small", "", "intestine"},   CompanionWord{"large", "", "bowel"},
    CompanionWord{"large", "", "intestine"},   CompanionWord{"major", "teres", ""},
    CompanionWord{"minor", "teres", ""},       CompanionWord{"major", "pectoralis", ""},
    CompanionWord{"minor", "pectoralis", ""},  CompanionWord{"major", "psoas", ""},
    CompanionWord{"minor", "psoas", ""},       CompanionWord{"major", "zygomaticus", ""},
    CompanionWord{"minor", "zygomaticus", ""}, CompanionWord{"long", "biceps", "head"},
    CompanionWord{"short", "biceps", "head"},  CompanionWord{"dc", "ventral", ""},
    CompanionWord{"magnus", "adductor", ""},   CompanionWord{"hoffa", "", "fat"},
    CompanionWord{"maximus", "gluteus", ""},   CompanionWord{"medius", "gluteus", ""},
    CompanionWord{"minimus", "gluteus", ""},   CompanionWord{"oral", "", "cavity"},
    CompanionWord{"cord", "spinal", ""},       CompanionWord{"stem", "brain", ""},
    CompanionWord{"band", "iliotibial", ""},   CompanionWord{"band", "tract", ""},
    CompanionWord{"common", "", "carotid"},    CompanionWord{"common", "", "iliac"},
    CompanionWord{"wall", "abdominal", ""},    CompanionWord{"wall", "bladder", ""},
    CompanionWord{"wall", "thoracic", ""},     CompanionWord{"wall", "vessel", ""},
    CompanionWord{"pole", "", "frontal"},      CompanionWord{"pole", "", "occipital"},
    CompanionWord{"pole", "", "temporal"},     CompanionWord{"pole", "frontal", ""},
    CompanionWord{"pole", "occipital", ""},    CompanionWord{"pole", "temporal", ""},
    CompanionWord{"tissue", "soft", ""},       CompanionWord{"tissues", "soft", ""},
    CompanionWord{"wall", "airways", ""},      CompanionWord{"segment", "liver", ""},
    CompanionWord{"true", "", "lumen"},        CompanionWord{"false", "", "lumen"},
    CompanionWord{"hard", "", "palate"},       CompanionWord{"non", "", "coronary"},
    CompanionWord{"hand", "phalanges", ""},    CompanionWord{"feet", "phalanges", ""},
    CompanionWord{"horn", "frontal", ""},      CompanionWord{"horn", "occipital", ""},
    CompanionWord{"horn", "temporal", ""},     CompanionWord{"arch", "zygomatic", ""},
    CompanionWord{"arch", "aortic", ""},       CompanionWord{"space", "subarachnoid", ""},
    CompanionWord{"start", "left", ""},        CompanionWord{"start", "right", ""},
    CompanionWord{"implant", "hip", ""},       CompanionWord{"oblique", "external", ""},
    CompanionWord{"oblique", "internal", ""},  CompanionWord{"oblique", "inferior", ""},
    CompanionWord{"oblique", "superior", ""},  CompanionWord{"capsule", "internal", ""},
};

// Complete names whose words do not identify a structure by themselves: Bridge, for example, is also a family
// name.
constexpr std::array<std::string_view, 7> kWholeNames{"head",    "face",       "bridge",          "crown",
                                                      "implant", "body_trunc", "body_extremities"};

// neutral words of file names, which do not identify a person
constexpr std::string_view kNeutralWords =
    "label labels labelmap seg segs dseg segment segmentation segmentations mask masks roi binary volume vol "
    "image img data file output out result pred prediction final new copy test sub subject ses patient case "
    "untitled surface surf mesh model structure stl obj ply vtk vtp nii nrrd mha mhd gz x r l a b c d lps "
    "ras "
    "smooth smoothed mm cm run ct mr mri acq desc space";

std::set<std::string_view> set_of(std::string_view words) {
  const auto list = split_spaces(words);
  return {list.begin(), list.end()};
}

bool is_digit(char c) {
  return c >= '0' && c <= '9';
}
bool is_capital(char c) {
  return c >= 'A' && c <= 'Z';
}
// includes every non-ASCII byte, so that words in other scripts count as unknown words
bool is_word(char c) {
  return is_capital(c) || (c >= 'a' && c <= 'z') || static_cast<unsigned char>(c) >= 0x80;
}

struct Token {
  std::string_view text;
  std::string lower;
  std::size_t begin = 0;
  bool number = false;
  bool kept = false;
};

std::vector<Token> tokens_of(std::string_view text) {
  std::vector<Token> tokens;
  for (std::size_t n = 0; n < text.size();) {
    const std::size_t begin = n;
    if (is_digit(text[n])) {
      while (n < text.size() && is_digit(text[n])) ++n;
    } else if (is_word(text[n])) {
      ++n;
      while (n < text.size() && is_word(text[n]) && !(is_capital(text[n]) && !is_capital(text[n - 1]))) ++n;
    } else {
      ++n;
      continue;
    }
    Token token{text.substr(begin, n - begin), {}, begin, is_digit(text[begin]), false};
    token.lower = lower_case(token.text);
    tokens.push_back(std::move(token));
  }
  return tokens;
}

bool is_structure(const std::string& word) {
  static const std::set<std::string_view> known = set_of(kStructures);
  if (known.contains(word)) return true;
  return word.size() > 3 && word.back() == 's' &&
         known.contains(std::string_view(word).substr(0, word.size() - 1));
}

bool in_company(const std::vector<Token>& tokens, std::size_t n) {
  return std::ranges::any_of(kCompanionWords, [&](const CompanionWord& one) {
    if (tokens[n].lower != one.word) return false;
    const bool before = one.before.empty() || (n > 0 && tokens[n - 1].lower == one.before);
    return before && (one.after.empty() || (n + 1 < tokens.size() && tokens[n + 1].lower == one.after));
  });
}

// vertebral level such as L5 or T12: a letter and a number, which are two tokens
bool is_level(const std::vector<Token>& tokens, std::size_t n) {
  static constexpr std::string_view kSpine = "ctls";
  return tokens[n].lower.size() == 1 && kSpine.find(tokens[n].lower[0]) != kSpine.npos &&
         n + 1 < tokens.size() && tokens[n + 1].number && tokens[n + 1].text.size() <= 2 &&
         tokens[n + 1].begin == tokens[n].begin + 1;
}

}  // namespace

AnatomyInName anatomy_in(std::string_view text) {
  static const std::set<std::string_view> qualities = set_of(kQualities), neutral = set_of(kNeutralWords);
  AnatomyInName found;
  if (std::ranges::find(kWholeNames, text) != kWholeNames.end()) {
    found.name = text;
    return found;
  }
  std::vector<Token> tokens = tokens_of(text);
  bool any = false;
  for (std::size_t n = 0; n < tokens.size(); ++n) {
    Token& token = tokens[n];
    if (token.number) {
      // dates and patient numbers have more digits, or several numbers
      const bool follows = n > 0 && tokens[n - 1].kept && !tokens[n - 1].number;
      const bool last = n + 1 == tokens.size() || !tokens[n + 1].number;
      // teeth and their pulps have three digits in FDI notation
      const bool is_tooth = follows && tokens[n - 1].lower == "fdi";
      token.kept = follows && last && token.text.size() <= (is_tooth ? 3 : 2);
      found.left_out = found.left_out || (!token.kept && token.text.size() > 2);
      continue;
    }
    const bool structure = is_structure(token.lower) || in_company(tokens, n);
    any = any || structure;
    token.kept = structure || qualities.contains(token.lower) || is_level(tokens, n);
    found.left_out = found.left_out || (!token.kept && !neutral.contains(token.lower));
  }
  if (!any) return found;
  std::size_t end = 0;
  bool row = false;  // the previous token is part of the name
  for (const Token& token : tokens) {
    if (token.kept) {
      const std::string_view between = text.substr(end, token.begin - end);
      const bool plain = between.empty() || between == " " || between == "_" || between == "-";
      if (!found.name.empty()) found.name += row && plain ? between : "_";
      found.name += token.text;
    }
    row = token.kept;
    end = token.begin + token.text.size();
  }
  return found;
}

}  // namespace palpate::volume_io
