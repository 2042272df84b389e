// Every function of palpate.h with arguments that are null, hostile or of another type: an error each, and
// nothing ends the program.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

#include "base/test_seed.h"
#include "c/test_block.h"

namespace palpate::c::test {
namespace {

const double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

class Garbage : public ::testing::Test {
 protected:
  void expect_error(plp_status status) const {
    EXPECT_NE(status, PLP_OK);
    EXPECT_NE(status, PLP_INTERNAL) << plp_last_error();
    EXPECT_STRNE(plp_last_error(), "");
  }

  Block block_;
  Owned<plp_model> model_ = block_.model();
  Owned<plp_session> session_ = session_of(model_.get());
};

TEST_F(Garbage, NullInInitFunctionsIsAnError) {
  expect_error(plp_labels_init(nullptr, sizeof(plp_labels)));
  expect_error(plp_tissue_init(nullptr, sizeof(plp_tissue)));
  expect_error(plp_structure_init(nullptr, sizeof(plp_structure)));
  expect_error(plp_tool_init(nullptr, sizeof(plp_tool)));
  expect_error(plp_model_options_init(nullptr, sizeof(plp_model_options)));
  expect_error(plp_cut_init(nullptr, sizeof(plp_cut)));
  expect_error(plp_pose_init(nullptr, sizeof(plp_pose)));
  expect_error(plp_wrench_init(nullptr, sizeof(plp_wrench)));
  expect_error(plp_record_init(nullptr, sizeof(plp_record)));
  expect_error(plp_session_options_init(nullptr, sizeof(plp_session_options)));
  expect_error(plp_run_options_init(nullptr, sizeof(plp_run_options)));
  expect_error(plp_loop_options_init(nullptr, sizeof(plp_loop_options)));
  expect_error(plp_section_init(nullptr, sizeof(plp_section)));
  expect_error(plp_camera_init(nullptr, sizeof(plp_camera)));
}

TEST_F(Garbage, NullModelIsAnError) {
  plp_model* model = nullptr;
  double value = 0;
  std::size_t count = 0;
  const float* voxels = nullptr;
  expect_error(plp_model_create(nullptr, nullptr, 0, nullptr, 0, nullptr, 0, nullptr, &model));
  expect_error(plp_model_create(&block_.labels, nullptr, 1, nullptr, 0, nullptr, 0, nullptr, &model));
  expect_error(plp_model_create(&block_.labels, nullptr, 0, nullptr, 1, nullptr, 0, nullptr, &model));
  expect_error(plp_model_create(&block_.labels, nullptr, 0, nullptr, 0, nullptr, 1, nullptr, &model));
  expect_error(plp_model_create(&block_.labels, nullptr, 0, nullptr, 0, nullptr, 0, nullptr, nullptr));
  expect_error(plp_model_load(nullptr, nullptr, nullptr, &model));
  expect_error(plp_model_load("palpation-block", nullptr, nullptr, nullptr));
  expect_error(plp_model_change(nullptr, 0, &block_.tissue, &model));
  expect_error(plp_model_change(model_.get(), 0, nullptr, &model));
  expect_error(plp_model_change(model_.get(), 0, &block_.tissue, nullptr));
  expect_error(plp_model_cut(nullptr, nullptr, 0, &model));
  expect_error(plp_model_cut(model_.get(), nullptr, 1, &model));
  expect_error(plp_model_cut(model_.get(), nullptr, 0, nullptr));
  expect_error(plp_model_info_get(model_.get(), nullptr));
  expect_error(plp_model_tissue(model_.get(), 0, nullptr));
  expect_error(plp_model_structure(model_.get(), 0, nullptr));
  expect_error(plp_model_sample(model_.get(), PLP_PROXY, nullptr, 1, &value, nullptr));
  expect_error(plp_model_sample(model_.get(), PLP_PROXY, &value, 1, nullptr, nullptr));
  expect_error(plp_model_labels(model_.get(), nullptr, 0));
  expect_error(plp_model_scan(model_.get(), &voxels, &count));
  expect_error(plp_model_scan(model_.get(), nullptr, nullptr));
  EXPECT_EQ(model, nullptr);
  plp_model_destroy(nullptr);
}

TEST_F(Garbage, NullPictureArgumentsAreErrors) {
  plp_section section;
  plp_section_init(&section, sizeof section);
  plp_camera camera;
  plp_camera_init(&camera, sizeof camera);
  expect_error(plp_model_section(model_.get(), nullptr, nullptr, 0));
  expect_error(plp_model_section(model_.get(), &section, nullptr, 3 * 512 * 512));
  expect_error(plp_model_section_labels(nullptr, &section, nullptr, 0));
  expect_error(plp_model_section_labels(model_.get(), &section, nullptr, 512 * 512));
  expect_error(plp_model_picture(model_.get(), nullptr, nullptr, 0, nullptr));
  expect_error(plp_model_picture(model_.get(), &camera, nullptr, 3 * 512 * 512, nullptr));
}

TEST_F(Garbage, NullSessionIsAnError) {
  plp_session* session = nullptr;
  plp_pose pose = press(1)[0];
  plp_wrench wrench;
  plp_wrench_init(&wrench, sizeof wrench);
  std::uint64_t number = 0;
  expect_error(plp_session_create(nullptr, nullptr, &session));
  expect_error(plp_session_create(model_.get(), nullptr, nullptr));
  expect_error(plp_session_tick(nullptr, &pose, 1e-3, &wrench));
  expect_error(plp_session_tick(session_.get(), nullptr, 1e-3, &wrench));
  expect_error(plp_session_tick(session_.get(), &pose, 1e-3, nullptr));
  expect_error(plp_session_run(nullptr, &pose, 1, 1e-3, nullptr, nullptr));
  expect_error(plp_session_run(session_.get(), nullptr, 1, 1e-3, nullptr, nullptr));
  expect_error(plp_session_record(session_.get(), 0, nullptr));
  expect_error(plp_session_reset(nullptr));
  expect_error(plp_session_set_model(session_.get(), nullptr));
  expect_error(plp_session_hash(session_.get(), nullptr, &number));
  EXPECT_EQ(session, nullptr);
  plp_session_destroy(nullptr);
}

TEST_F(Garbage, NullRunIsAnError) {
  plp_run* run = nullptr;
  expect_error(plp_simulate(nullptr, nullptr, &run));
  expect_error(plp_simulate(model_.get(), nullptr, nullptr));
  expect_error(plp_run_info_get(nullptr, nullptr));
  expect_error(plp_run_records(nullptr, 0, 0, 1, nullptr));
  EXPECT_EQ(plp_run_trouble(nullptr, 0), nullptr);
  plp_run_destroy(nullptr);
}

TEST_F(Garbage, NullLoopIsAnError) {
  plp_loop* loop = nullptr;
  plp_pose pose = press(1)[0];
  expect_error(plp_loop_start(nullptr, nullptr, &loop));
  expect_error(plp_loop_start(model_.get(), nullptr, nullptr));
  expect_error(plp_loop_post(nullptr, &pose));
  expect_error(plp_loop_snapshot(nullptr, nullptr));
  expect_error(plp_loop_set_model(nullptr, model_.get()));
  expect_error(plp_loop_emergency_stop(nullptr));
  expect_error(plp_loop_health_get(nullptr, nullptr));
  expect_error(plp_loop_stop(nullptr));
  plp_loop_destroy(nullptr);
}

TEST_F(Garbage, NullRecordingIsAnError) {
  plp_recording* recording = nullptr;
  double value = 0;
  expect_error(plp_recording_open(nullptr, &recording));
  expect_error(plp_recording_open("/nowhere/run.h5", &recording));
  expect_error(plp_recording_open("/nowhere/run.h5", nullptr));
  expect_error(plp_recording_info_get(nullptr, nullptr));
  expect_error(plp_recording_records(nullptr, 0, 0, 1, nullptr));
  expect_error(plp_recording_column(nullptr, 0, "tick", 0, 1, &value));
  plp_recording_destroy(nullptr);
}

TEST_F(Garbage, NullStructNameIsAnError) {
  expect_error(plp_struct_field(nullptr, 0, nullptr));
  EXPECT_EQ(plp_struct_size(nullptr), 0u);
}

TEST_F(Garbage, RejectsHandlesOfAnotherType) {
  auto* const model = reinterpret_cast<plp_model*>(session_.get());
  auto* const session = reinterpret_cast<plp_session*>(model_.get());
  plp_model_info info;
  info.size = sizeof info;
  expect_error(plp_model_info_get(model, &info));
  expect_error(plp_session_reset(session));
  plp_model_destroy(model);
  plp_session_destroy(session);
  EXPECT_EQ(plp_session_reset(session_.get()), PLP_OK) << "it is still there";
}

TEST_F(Garbage, ASizeThatNoStructHasIsAnError) {
  for (const std::uint32_t size : {0u, 1u, 4u, 0xffffffffu}) {
    plp_labels labels = block_.labels;
    labels.size = size;
    plp_model* model = nullptr;
    expect_error(
        plp_model_create(&labels, &block_.tissue, 1, &block_.structure, 1, nullptr, 0, nullptr, &model));
    plp_pose pose = press(1)[0];
    pose.size = size;
    expect_error(plp_session_run(session_.get(), &pose, 1, 1e-3, nullptr, nullptr));
    plp_model_info info;
    info.size = size;
    expect_error(plp_model_info_get(model_.get(), &info));
    expect_error(plp_pose_init(&pose, size));
  }
  // a later header's member, which this library would ignore
  struct {
    plp_session_options known;
    double later;
  } options;
  plp_session_options_init(&options.known, sizeof options.known);
  options.known.size = sizeof options;
  options.later = 1;
  plp_session* session = nullptr;
  expect_error(plp_session_create(model_.get(), &options.known, &session));
  options.later = 0;
  ASSERT_EQ(plp_session_create(model_.get(), &options.known, &session), PLP_OK) << plp_last_error();
  plp_session_destroy(session);
}

TEST_F(Garbage, ATickOfNoDurationLeavesTheSessionAsItWas) {
  const auto poses = press(700);
  ASSERT_EQ(plp_session_run(session_.get(), poses.data(), poses.size(), 1e-3, nullptr, nullptr), PLP_OK);
  const auto hash = [&] {
    std::uint64_t ticks = 0, run_hash = 0;
    EXPECT_EQ(plp_session_hash(session_.get(), &ticks, &run_hash), PLP_OK);
    return run_hash;
  };
  const std::uint64_t before = hash();
  for (const double dt_s : {-1.0, kNaN, kInfinity, -kInfinity}) {
    plp_wrench wrench;
    plp_wrench_init(&wrench, sizeof wrench);
    wrench.force_N[0] = 5;
    EXPECT_EQ(plp_session_tick(session_.get(), poses.data(), dt_s, &wrench), PLP_BAD_INPUT) << dt_s;
    EXPECT_EQ(wrench.force_N[0], 0) << dt_s;
    EXPECT_EQ(plp_session_run(session_.get(), poses.data(), 3, dt_s, nullptr, nullptr), PLP_BAD_INPUT)
        << dt_s;
  }
  EXPECT_EQ(hash(), before);
}

// a double or integer of any kind, in every member that is a number
class Numbers {
 public:
  explicit Numbers(unsigned seed) : random_(seed) {}

  double real() {
    constexpr std::array kValues{0.0, -1.0, 1.0, 1e-300, 1e300, 5e-324, 1e9, -0.0, 0.5, 3.0};
    switch (random_() % 5) {
      case 0:
        return kNaN;
      case 1:
        return random_() % 2 == 0 ? kInfinity : -kInfinity;
      case 2: {
        const std::uint64_t bits = random_();
        double value;
        std::memcpy(&value, &bits, sizeof value);
        return value;
      }
      default:
        return kValues[random_() % kValues.size()];
    }
  }
  std::int64_t whole() {
    constexpr std::array<std::int64_t, 8> kValues{0, 1, -1, 2, 4, 65536, INT32_MAX, INT32_MIN};
    return random_() % 3 == 0 ? static_cast<std::int64_t>(random_()) : kValues[random_() % kValues.size()];
  }
  bool one_in(unsigned count) { return random_() % count == 0; }

  /// Fills some numbers of a struct, by its description; pointers and size stay.
  template <class Struct>
  void spoil(const char* name, Struct& value, unsigned one_of) {
    plp_field field;
    field.size = sizeof field;
    for (std::size_t n = 1; plp_struct_field(name, n, &field) == PLP_OK; ++n) {
      auto* to = reinterpret_cast<unsigned char*>(&value) + field.offset;
      for (std::uint32_t c = 0; c < field.count; ++c) {
        if (!one_in(one_of)) continue;
        put(field.type, c, to);
      }
    }
  }

 private:
  void put(int type, std::uint32_t index, unsigned char* to) {
    if (type == PLP_FLOAT64) {
      const double value = real();
      std::memcpy(to + 8 * index, &value, 8);
    } else if (type == PLP_INT32 || type == PLP_UINT32) {
      const auto value = static_cast<std::int32_t>(whole());
      std::memcpy(to + 4 * index, &value, 4);
    } else if (type == PLP_INT64 || type == PLP_UINT64) {
      const std::int64_t value = whole();
      std::memcpy(to + 8 * index, &value, 8);
    }
  }

  std::mt19937_64 random_;
};

TEST_F(Garbage, SpoiltNumbersGiveAnErrorOrForcesWithinTheLimit) {
  const unsigned seed = palpate::test::test_seed();
  Numbers numbers(seed);
  int models = 0, ticked = 0;
  for (int n = 0; n < 250; ++n) {
    plp_labels labels = block_.labels;
    numbers.spoil("plp_labels", labels, 40);
    // a volume of other dimensions or strides would be read where it is not
    std::memcpy(labels.strides_bytes, block_.labels.strides_bytes, sizeof labels.strides_bytes);
    for (int& dim : labels.dims)
      if (dim > 0) dim = std::min(dim, kVoxels);
    if (labels.type != PLP_UINT8) labels.type = numbers.one_in(9) ? -3 : PLP_UINT16;
    plp_tissue tissue = block_.tissue;
    numbers.spoil("plp_tissue", tissue, 20);
    plp_structure structure = block_.structure;
    numbers.spoil("plp_structure", structure, 20);
    plp_tool tool;
    plp_tool_init(&tool, sizeof tool);
    numbers.spoil("plp_tool", tool, 20);
    plp_model_options options;
    plp_model_options_init(&options, sizeof options);
    numbers.spoil("plp_model_options", options, 20);
    plp_model* made = nullptr;
    const plp_status status = plp_model_create(&labels, &tissue, 1, &structure, 1, &tool, 1, &options, &made);
    ASSERT_NE(status, PLP_INTERNAL) << plp_last_error() << ", seed " << seed;
    if (status != PLP_OK) continue;
    const Owned<plp_model> model(made);
    ++models;

    plp_session_options session_options;
    plp_session_options_init(&session_options, sizeof session_options);
    if (numbers.one_in(2)) numbers.spoil("plp_session_options", session_options, 20);
    plp_session* started = nullptr;
    if (plp_session_create(made, &session_options, &started) != PLP_OK) continue;
    const Owned<plp_session> session(started);
    std::vector<plp_pose> poses = press(60);
    plp_wrench wrench[4];
    plp_wrench_init(&wrench[0], sizeof wrench[0]);
    for (std::size_t t = 0; t + 4 < poses.size(); ++t) {
      numbers.spoil("plp_pose", poses[t], 40);
      const double dt_s = numbers.one_in(9) ? numbers.real() : 1e-3;
      ticked += plp_session_tick(started, &poses[t], dt_s, wrench) == PLP_OK;
      for (const double force_N : wrench[0].force_N) {
        ASSERT_TRUE(std::isfinite(force_N)) << "seed " << seed;
        ASSERT_LE(std::abs(force_N), session_options.max_force_N * (1 + 1e-9)) << "seed " << seed;
      }
    }
    plp_cut cut;
    plp_cut_init(&cut, sizeof cut);
    cut.radius_mm = 2;
    numbers.spoil("plp_cut", cut, 5);
    plp_model* next = nullptr;
    ASSERT_NE(plp_model_cut(made, &cut, 1, &next), PLP_INTERNAL) << plp_last_error();
    plp_model_destroy(next);
    tissue = block_.tissue;
    numbers.spoil("plp_tissue", tissue, 4);
    ASSERT_NE(plp_model_change(made, static_cast<std::size_t>(numbers.whole()), &tissue, &next),
              PLP_INTERNAL);
    plp_model_destroy(next);
    double points[6], values[2], slopes[6];
    for (double& number : points) number = numbers.real();
    ASSERT_NE(plp_model_sample(made, static_cast<std::int32_t>(numbers.whole()), points, 2, values, slopes),
              PLP_INTERNAL);
  }
  EXPECT_GT(models, 20);
  EXPECT_GT(ticked, 500);
}

TEST_F(Garbage, SpoiltPicturesAreErrorsOrDrawn) {
  Numbers numbers(palpate::test::test_seed());
  std::array<std::uint8_t, 192> rgb;
  const auto bytes = [](std::int32_t width, std::int32_t height) {
    return width > 0 && height > 0 ? static_cast<std::size_t>(3 * width * height) : std::size_t{0};
  };
  int drawn = 0;
  for (int n = 0; n < 300; ++n) {
    plp_section section;
    plp_section_init(&section, sizeof section);
    section.width_px = section.height_px = 8;
    numbers.spoil("plp_section", section, 12);
    section.width_px = std::min(section.width_px, 8);
    section.height_px = std::min(section.height_px, 8);
    plp_status status =
        plp_model_section(model_.get(), &section, rgb.data(), bytes(section.width_px, section.height_px));
    ASSERT_NE(status, PLP_INTERNAL) << plp_last_error();
    drawn += status == PLP_OK;
    plp_camera camera;
    plp_camera_init(&camera, sizeof camera);
    camera.width_px = camera.height_px = 8;
    numbers.spoil("plp_camera", camera, 12);
    camera.width_px = std::min(camera.width_px, 8);
    camera.height_px = std::min(camera.height_px, 8);
    if (n % 8 != 0) continue;
    status = plp_model_picture(model_.get(), &camera, rgb.data(), bytes(camera.width_px, camera.height_px),
                               nullptr);
    ASSERT_NE(status, PLP_INTERNAL) << plp_last_error();
  }
  EXPECT_GT(drawn, 20);
}

TEST_F(Garbage, SpoiltOptionsOfRunsAndLoopsAreErrors) {
  Numbers numbers(palpate::test::test_seed());
  for (int n = 0; n < 200; ++n) {
    plp_run_options options;
    plp_run_options_init(&options, sizeof options);
    options.script_text = "[[step]]\nnothing = 1\n";
    numbers.spoil("plp_run_options", options, 3);
    plp_run* run = nullptr;
    expect_error(plp_simulate(model_.get(), &options, &run));
    plp_loop_options loop_options;
    plp_loop_options_init(&loop_options, sizeof loop_options);
    plp_session_options session;
    plp_session_options_init(&session, sizeof session);
    session.devices = 2;  // a loop has one
    numbers.spoil("plp_session_options", session, 3);
    if (session.devices == 1) continue;
    loop_options.session = &session;
    plp_loop* loop = nullptr;
    expect_error(plp_loop_start(model_.get(), &loop_options, &loop));
  }
}

}  // namespace
}  // namespace palpate::c::test
