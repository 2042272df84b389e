#include <gmock/gmock.h>

#include <random>

#include "base/test_seed.h"
#include "phantoms/phantom_keys.h"

namespace palpate {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(PhantomName, ParametersAreRead) {
  const auto parsed = parse_phantom(
      "knee-phantom:side=right,spacing=0.28x0.3x1,size=0.7,seed=12,lesion=6,lesion-in=tibia,lesion-depth=2.5,"
      "defect=5,defect-in=patellar_cartilage,missing=medial_meniscus+femoral_cartilage,noise=0.4,islands=20,"
      "scan-seed=9");
  ASSERT_TRUE(parsed.ok()) << parsed.error().message();
  const auto& knee = std::get<KneeParameters>(*parsed);
  EXPECT_EQ(knee.side, BodySide::kRight);
  EXPECT_EQ(knee.settings.spacing_mm, Eigen::Vector3d(0.28, 0.3, 1));
  EXPECT_EQ(knee.size, 0.7);
  EXPECT_EQ(knee.settings.seed, 12u);
  EXPECT_EQ(knee.lesion_mm, 6);
  EXPECT_EQ(knee.lesion_in, "tibia");
  EXPECT_EQ(knee.lesion_depth_mm, 2.5);
  EXPECT_EQ(knee.defect_mm, 5);
  EXPECT_EQ(knee.defect_in, "patellar_cartilage");
  EXPECT_THAT(knee.missing, ::testing::ElementsAre("femoral_cartilage", "medial_meniscus"));
  EXPECT_EQ(knee.settings.noise_mm, 0.4);
  EXPECT_EQ(knee.settings.islands, 20u);
  EXPECT_EQ(knee.settings.scan_seed, 9u);

  const auto skull = parse_phantom("skull-phantom:brain=no,temporal=3");
  ASSERT_TRUE(skull.ok());
  EXPECT_FALSE(std::get<SkullParameters>(*skull).brain);
  EXPECT_EQ(std::get<SkullParameters>(*skull).temporal_mm, 3);
}

TEST(PhantomName, IsTheSameHoweverItWasWritten) {
  const auto canonical = [](const std::string& name) {
    const auto parsed = parse_phantom(name);
    EXPECT_TRUE(parsed.ok()) << parsed.error().message();
    return parsed ? phantom_name(*parsed) : "";
  };
  for (const std::string& name : phantom_names()) EXPECT_EQ(canonical(name), name);
  EXPECT_EQ(canonical("knee-phantom:spacing=0.50,side=right"), "knee-phantom:side=right,spacing=0.5");
  EXPECT_EQ(canonical("knee-phantom:spacing=0.5x0.5x0.5,side=left"), "knee-phantom:spacing=0.5");
  EXPECT_EQ(canonical("knee-phantom:spacing=0.6,seed=0,size=1.0,lesion=-0"), "knee-phantom");
  EXPECT_EQ(canonical("knee-phantom:missing=patellar_ligament+medial_meniscus"),
            "knee-phantom:missing=medial_meniscus+patellar_ligament");
  EXPECT_EQ(canonical("skull-phantom:spacing=1"), "skull-phantom");
  EXPECT_EQ(canonical("shell-phantom:spacing=1,thickness=1.8"), "shell-phantom:spacing=1,thickness=1.8");
}

TEST(PhantomName, ErrorsNameTheFaultAndRemedy) {
  const auto message = [](const std::string& name) {
    const auto parsed = parse_phantom(name);
    EXPECT_FALSE(parsed.ok()) << name;
    if (parsed) return std::string();
    EXPECT_EQ(parsed.error().kind, ErrorKind::kBadInput);
    return parsed.error().message();
  };
  EXPECT_THAT(message("elbow-phantom"), AllOf(HasSubstr("knee-phantom"), HasSubstr("shell-phantom")));
  EXPECT_THAT(message("knee-phantom:sde=right"),
              AllOf(HasSubstr("no key `sde`"), HasSubstr("side: left or right"), HasSubstr("0.2 ... 3 mm")));
  EXPECT_THAT(message("shell-phantom:side=right"), AllOf(HasSubstr("no key `side`"), HasSubstr("thickness")));
  EXPECT_THAT(message("knee-phantom:side=front"), HasSubstr("`side` is left or right"));
  for (const char* spacing :
       {"0.1", "3.5", "nan", "inf", "-1", "0.5mm", "", "0.5x0.5", "0.5x0.5x", "1x1x1x1", "x"})
    EXPECT_THAT(message("knee-phantom:spacing=" + std::string(spacing)),
                HasSubstr("`spacing` is 0.2 ... 3 mm"))
        << spacing;
  for (const char* seed : {"-1", "1.5", "99999999999", "a", "", "18446744073709551617"})
    EXPECT_THAT(message("knee-phantom:seed=" + std::string(seed)), HasSubstr("`seed` is 0 ... 1000000000"))
        << seed;
  EXPECT_THAT(message("knee-phantom:seed=1,seed=1"), HasSubstr("`seed` is given twice"));
  for (const char* nothing : {"", ",", "seed", "seed=1,", "=1"})
    EXPECT_THAT(message("knee-phantom:" + std::string(nothing)), HasSubstr("its keys are")) << nothing;
  EXPECT_THAT(message("knee-phantom:missing=femur"), HasSubstr("`missing` is any of"));
  EXPECT_THAT(message("knee-phantom:missing=patellar_ligament+patellar_ligament"),
              HasSubstr("`missing` is any of"));
  EXPECT_THAT(message("knee-phantom:lesion-in=tibia"), HasSubstr("without `lesion`"));
  EXPECT_THAT(message("knee-phantom:lesion-depth=2"), HasSubstr("without `lesion`"));
  EXPECT_THAT(message("knee-phantom:lesion-at=2"), HasSubstr("without `lesion`"));
  EXPECT_THAT(message("knee-phantom:visible=no"), HasSubstr("without `lesion`"));
  EXPECT_THAT(message("knee-phantom:lesion=3,lesion-at=1"), HasSubstr("not a place on femur, which has 1"));
  EXPECT_THAT(message("knee-phantom:lesion=3,lesion-in=femoral_cartilage,lesion-at=4"),
              HasSubstr("`lesion-at` is"));
  EXPECT_THAT(message("knee-phantom:defect-in=patellar_cartilage"), HasSubstr("without `defect`"));
  EXPECT_THAT(message("knee-phantom:lesion=3,lesion-in=medial_meniscus,missing=medial_meniscus"),
              HasSubstr("`missing`"));
  EXPECT_THAT(message("knee-phantom:lesion=2,spacing=0.3x0.3x1.5"),
              HasSubstr("too small for voxels of 1.5 mm"));
  EXPECT_THAT(message("shell-phantom:thickness=1,spacing=0.6"), HasSubstr("diagonal of a voxel, 1.04 mm"));
  EXPECT_THAT(message("shell-phantom:radius=5,thickness=5"), HasSubstr("no cavity"));
  EXPECT_THAT(message("skull-phantom:temporal=7"), HasSubstr("thicker than the rest"));
  EXPECT_THAT(message("gland-phantom:skin=0.5"), HasSubstr("`skin` of 0.5 mm"));
  EXPECT_THAT(message("temporal-bone:plate=0.6"), HasSubstr("`plate` of 0.6 mm"));
  EXPECT_THAT(message("temporal-bone:cortex=0.6"), HasSubstr("`cortex` of 0.6 mm"));
  EXPECT_THAT(message("temporal-bone:cells=1"), HasSubstr("too small for voxels of 0.4 mm"));
}

TEST(PhantomName, RejectsLargePhantomsBeforeAllocating) {
  const auto refused = parse_phantom("skull-phantom:spacing=0.2");
  ASSERT_FALSE(refused.ok());
  EXPECT_THAT(refused.error().what, HasSubstr("889 million voxels; a phantom has at most 200 million"));
  // the suggested value is accepted
  const std::string& remedy = refused.error().remedy;
  const auto from = remedy.find("spacing=");
  ASSERT_NE(from, std::string::npos) << remedy;
  const std::string advice = remedy.substr(from, remedy.find(' ', from) - from);
  EXPECT_TRUE(parse_phantom("skull-phantom:" + advice).ok()) << advice;
  // also for parameters that do not come from a name
  SkullParameters skull;
  skull.settings.spacing_mm.setConstant(0.2);
  EXPECT_EQ(make_phantom(skull).error().what, refused.error().what);
  skull.settings.spacing_mm.setConstant(0);
  EXPECT_THAT(make_phantom(skull).error().what, HasSubstr("`spacing` is"));
  skull.settings.spacing_mm.setConstant(std::nan(""));
  EXPECT_THAT(make_phantom(skull).error().what, HasSubstr("`spacing` is"));
}

// Sets every key to another value within its range.
class Shuffler final : public PhantomKeyVisitor {
 public:
  explicit Shuffler(std::mt19937_64& random) : random_(random) {}
  void number(const PhantomKey&, double smallest, double largest, double& value) override {
    if (chance()) value = smallest + (largest - smallest) * unit();
  }
  void integer(const PhantomKey&, std::uint64_t largest, std::uint64_t& value) override {
    if (chance()) value = random_() % (largest + 1);
  }
  void edges(const PhantomKey&, double smallest, double largest, Eigen::Vector3d& value) override {
    if (!chance()) return;
    for (int a = 0; a < 3; ++a) value[a] = smallest + (largest - smallest) * unit();
    if (chance()) value.setConstant(value[0]);
  }
  void word(const PhantomKey&, std::span<const std::string_view> words, std::string& value) override {
    if (chance()) value = words[random_() % words.size()];
  }
  void words(const PhantomKey&, std::span<const std::string_view> words,
             std::vector<std::string>& values) override {
    for (const std::string_view word : words)
      if (random_() % 4 == 0) values.emplace_back(word);
  }

 private:
  bool chance() { return random_() % 2 == 0; }
  double unit() { return static_cast<double>(random_() >> 11) * 0x1.0p-53; }
  std::mt19937_64& random_;
};

TEST(PhantomName, AnyParametersComeBackFromTheirName) {
  std::mt19937_64 random(test::test_seed());
  int accepted = 0;
  for (int n = 0; n < 4000; ++n) {
    PhantomParameters parameters = mean_phantoms()[n % mean_phantoms().size()];
    Shuffler shuffler(random);
    visit_keys(parameters, shuffler);
    const std::string name = phantom_name(parameters);
    const auto parsed = parse_phantom(name);
    EXPECT_EQ(parsed.ok(), check_phantom(parameters).ok()) << name;
    if (!parsed) continue;
    ++accepted;
    EXPECT_EQ(phantom_name(*parsed), name);
  }
  EXPECT_GT(accepted, 400);
}

TEST(PhantomName, KeysStandInAlphabeticalOrder) {
  class Names final : public PhantomKeyVisitor {
   public:
    void number(const PhantomKey& key, double, double, double&) override { names.emplace_back(key.name); }
    void integer(const PhantomKey& key, std::uint64_t, std::uint64_t&) override {
      names.emplace_back(key.name);
    }
    void edges(const PhantomKey& key, double, double, Eigen::Vector3d&) override {
      names.emplace_back(key.name);
    }
    void word(const PhantomKey& key, std::span<const std::string_view>, std::string&) override {
      names.emplace_back(key.name);
    }
    void words(const PhantomKey& key, std::span<const std::string_view>, std::vector<std::string>&) override {
      names.emplace_back(key.name);
    }
    std::vector<std::string> names;
  };
  for (PhantomParameters parameters : mean_phantoms()) {
    EXPECT_TRUE(check_phantom(parameters).ok()) << base_name(parameters);
    Names names;
    visit_keys(parameters, names);
    EXPECT_TRUE(std::ranges::is_sorted(names.names)) << base_name(parameters);
  }
}

}  // namespace
}  // namespace palpate
