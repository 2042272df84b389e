#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "base/test_folder.h"
#include "base/test_wait.h"
#include "c/test_block.h"
#include "palpate/loading/loading.h"
#include "palpate/model/make_model.h"
#include "palpate/palpation/palpation.h"
#include "palpate/recording/recording.h"
#include "palpate/servo/servo.h"
#include "palpate_version.h"

namespace palpate::c::test {
namespace {

using ::testing::HasSubstr;

constexpr double kTick_s = 1e-3;
// a smooth surface stands out in the middle of a small face
constexpr double kRounded_mm = 0.25;

plp_record last_record(const plp_session* session) {
  plp_record record;
  plp_record_init(&record, sizeof record);
  EXPECT_EQ(plp_session_record(session, 0, &record), PLP_OK) << plp_last_error();
  return record;
}

std::uint64_t run_hash(const plp_session* session) {
  std::uint64_t ticks = 0, hash = 0;
  EXPECT_EQ(plp_session_hash(session, &ticks, &hash), PLP_OK);
  return hash;
}

plp_model_info info_of(const plp_model* model) {
  plp_model_info info;
  info.size = sizeof info;
  EXPECT_EQ(plp_model_info_get(model, &info), PLP_OK) << plp_last_error();
  return info;
}

TEST(Api, TheHeadersVersionIsTheLibrarys) {
  EXPECT_STREQ(plp_version(), PALPATE_VERSION);
  EXPECT_STREQ(PLP_VERSION, PALPATE_VERSION);
  const std::string parts = std::to_string(PLP_VERSION_MAJOR) + "." + std::to_string(PLP_VERSION_MINOR) +
                            "." + std::to_string(PLP_VERSION_PATCH);
  EXPECT_EQ(parts, PLP_VERSION);
}

TEST(Api, EveryMemberOfEveryStructIsDescribed) {
  const std::map<int, std::size_t> bytes{{PLP_UINT8, 1},
                                         {PLP_INT32, 4},
                                         {PLP_UINT32, 4},
                                         {PLP_UINT64, 8},
                                         {PLP_INT64, 8},
                                         {PLP_FLOAT64, 8},
                                         {PLP_STRING, sizeof(void*)},
                                         {PLP_POINTER, sizeof(void*)}};
  for (const char* name : {"plp_labels", "plp_tissue", "plp_structure", "plp_tool", "plp_model_options",
                           "plp_cut", "plp_model_info", "plp_section", "plp_camera", "plp_pose", "plp_wrench",
                           "plp_record", "plp_session_options", "plp_run_options", "plp_run_info",
                           "plp_loop_options", "plp_loop_health", "plp_recording_info", "plp_field"}) {
    std::size_t end = 0;
    plp_field field;
    field.size = sizeof field;
    for (std::size_t n = 0; plp_struct_field(name, n, &field) == PLP_OK; ++n) {
      // no gap but the padding in front of a member of eight bytes
      EXPECT_GE(field.offset, end) << name << "." << field.name;
      EXPECT_LT(field.offset - end, bytes.at(field.type)) << name << ": a member before " << field.name;
      end = field.offset + bytes.at(field.type) * field.count;
    }
    EXPECT_GT(end, 0u) << name;
    EXPECT_LT(plp_struct_size(name) - end, 8u) << name << ": a member behind the last one";
  }
  EXPECT_EQ(plp_struct_size("plp_nothing"), 0u);
}

TEST(Api, ABlockPushesBackByItsStiffness) {
  const auto model = Block().model();
  const auto session = session_of(model.get());
  const auto poses = press();
  plp_wrench wrench;
  plp_wrench_init(&wrench, sizeof wrench);
  for (const plp_pose& pose : poses)
    ASSERT_EQ(plp_session_tick(session.get(), &pose, kTick_s, &wrench), PLP_OK) << plp_last_error();
  const plp_record record = last_record(session.get());
  EXPECT_EQ(record.label, 1u);
  EXPECT_NEAR(record.depth_mm, 1, kRounded_mm);
  EXPECT_NEAR(wrench.force_N[2], record.depth_mm, 1e-3) << "1 N/mm, along +k";
  EXPECT_NEAR(wrench.force_N[0], 0, 0.05);
  EXPECT_EQ(record.tick, poses.size() - 1);
  EXPECT_NE(record.flags & PLP_FLAG_CONTACT, 0u);
}

TEST(Api, ManyTicksAreTheTicksOneByOne) {
  const auto model = Block().model();
  const auto one = session_of(model.get()), many = session_of(model.get());
  const auto poses = press();
  std::vector<plp_wrench> wrenches(poses.size());
  std::vector<plp_record> records(poses.size());
  plp_wrench_init(&wrenches[0], sizeof wrenches[0]);
  plp_record_init(&records[0], sizeof records[0]);
  ASSERT_EQ(plp_session_run(many.get(), poses.data(), poses.size(), kTick_s, wrenches.data(), records.data()),
            PLP_OK)
      << plp_last_error();
  plp_wrench wrench;
  plp_wrench_init(&wrench, sizeof wrench);
  for (std::size_t n = 0; n < poses.size(); ++n) {
    ASSERT_EQ(plp_session_tick(one.get(), &poses[n], kTick_s, &wrench), PLP_OK);
    ASSERT_EQ(std::memcmp(&wrench, &wrenches[n], sizeof wrench), 0) << n;
    ASSERT_EQ(records[n].tick, n);
  }
  EXPECT_EQ(run_hash(one.get()), run_hash(many.get()));
  ASSERT_EQ(plp_session_reset(one.get()), PLP_OK);
  ASSERT_EQ(plp_session_run(one.get(), poses.data(), poses.size(), kTick_s, nullptr, nullptr), PLP_OK);
  EXPECT_EQ(run_hash(one.get()), run_hash(many.get())) << "a session that was reset begins again";
}

// the same labels, tips and settings as a caller of C++ has them
TEST(Api, ARunHasTheHashThatItHasInCxx) {
  const Block block;
  const auto model = block.model();
  const auto session = session_of(model.get());
  const auto poses = press();
  ASSERT_EQ(plp_session_run(session.get(), poses.data(), poses.size(), kTick_s, nullptr, nullptr), PLP_OK);

  GridGeometry grid;
  grid.dims = {kVoxels, kVoxels, kVoxels};
  Tissue bone;
  bone.name = "bone";
  ModelParts parts;
  parts.labels = label_bricks(Volume<LabelId>(grid, block.voxels));
  parts.segments = {{1, "block", {}, 0, 1}};
  parts.tissues = {bone};
  parts.tissue_of_label = {-1, 0};
  auto made = make_model(std::move(parts));
  ASSERT_TRUE(made.ok());
  const ForceMethod proxy = ForceMethod::kProxy;
  const auto prepared = prepared_for(*made, {&proxy, 1});
  ASSERT_TRUE(prepared.ok());
  EXPECT_EQ(info_of(model.get()).content_hash, (*prepared)->content_hash);
  Parameters parameters;
  parameters.method = proxy;
  SessionState state;
  TickRecord record;
  Wrench wrench;
  std::uint64_t hash = 0;
  for (const plp_pose& pose : poses) {
    DeviceState device;
    device.tip = (*prepared)->X_WorldPatient * Point<Patient>(Eigen::Vector3d(pose.tip_mm));
    device.R_WorldTool = Eigen::Quaterniond((*prepared)->X_WorldPatient.linear());
    tick(**prepared, parameters, {&device, 1}, kTick_s, state, {&wrench, 1}, record);
    hash = mix_run_hash(hash, record.state_hash);
  }
  EXPECT_EQ(run_hash(session.get()), hash);
}

TEST(Api, ModelIsIndependentOfLabelTypeAndOrder) {
  Block block;
  const std::uint64_t hash = info_of(block.model().get()).content_hash;
  // signed, 8 bytes, k fastest, as NumPy's order of (i, j, k)
  std::vector<std::int64_t> turned(block.voxels.size());
  for (int k = 0; k < kVoxels; ++k)
    for (int j = 0; j < kVoxels; ++j)
      for (int i = 0; i < kVoxels; ++i)
        turned[static_cast<std::size_t>((i * kVoxels + j) * kVoxels + k)] =
            block.voxels[static_cast<std::size_t>((k * kVoxels + j) * kVoxels + i)];
  block.labels.voxels = turned.data();
  block.labels.type = PLP_INT64;
  block.labels.strides_bytes[0] = 8 * kVoxels * kVoxels;
  block.labels.strides_bytes[1] = 8 * kVoxels;
  block.labels.strides_bytes[2] = 8;
  EXPECT_EQ(info_of(block.model().get()).content_hash, hash);
  for (const std::int64_t no_label : {-1L, 65536L}) {
    turned[5] = no_label;
    plp_model* model = nullptr;
    EXPECT_EQ(block.create(&model), PLP_BAD_INPUT);
    EXPECT_THAT(plp_last_error(), HasSubstr("value that is no label"));
  }
}

TEST(Api, LabelWithoutStructureHasNoContact) {
  Block block;
  block.voxels[0] = 9;
  const auto model = block.model();
  ASSERT_EQ(info_of(model.get()).structures, 2u);
  plp_structure structure;
  plp_structure_init(&structure, sizeof structure);
  ASSERT_EQ(plp_model_structure(model.get(), 1, &structure), PLP_OK);
  EXPECT_EQ(structure.label, 9u);
  EXPECT_EQ(structure.tissue, -1);
  ASSERT_EQ(plp_model_structure(model.get(), 0, &structure), PLP_OK);
  EXPECT_STREQ(structure.name, "block");
  EXPECT_EQ(structure.tissue, 0);
  EXPECT_EQ(plp_model_structure(model.get(), 2, &structure), PLP_BAD_INPUT);
  plp_tissue tissue;
  plp_tissue_init(&tissue, sizeof tissue);
  ASSERT_EQ(plp_model_tissue(model.get(), 0, &tissue), PLP_OK);
  EXPECT_STREQ(tissue.name, "bone");
  EXPECT_EQ(tissue.stiffness_N_per_mm, 1);
}

TEST(Api, NextVersionChangesContactOfASession) {
  const auto model = Block().model();
  const auto session = session_of(model.get());
  const auto poses = press();
  ASSERT_EQ(plp_session_run(session.get(), poses.data(), poses.size(), kTick_s, nullptr, nullptr), PLP_OK);
  const auto rest = [&] {
    for (int n = 0; n < 300; ++n) {
      const plp_status status = plp_session_run(session.get(), &poses.back(), 1, kTick_s, nullptr, nullptr);
      EXPECT_EQ(status, PLP_OK);
    }
    return last_record(session.get());
  };

  plp_tissue tissue;
  plp_tissue_init(&tissue, sizeof tissue);
  ASSERT_EQ(plp_model_tissue(model.get(), 0, &tissue), PLP_OK);
  tissue.stiffness_N_per_mm = 0.5;
  plp_model* next = nullptr;
  ASSERT_EQ(plp_model_change(model.get(), 0, &tissue, &next), PLP_OK) << plp_last_error();
  const Owned<plp_model> softer(next);
  EXPECT_EQ(info_of(next).version, 2u);
  ASSERT_EQ(plp_session_set_model(session.get(), next), PLP_OK) << plp_last_error();
  const plp_record soft = rest();
  EXPECT_NEAR(soft.force_world_N[1], 0.5 * soft.depth_mm, 1e-3) << "+k is World's forward";

  plp_cut cut;
  plp_cut_init(&cut, sizeof cut);
  std::copy_n(poses.back().tip_mm, 3, cut.from_mm);
  std::copy_n(poses.back().tip_mm, 3, cut.to_mm);
  cut.radius_mm = 3;
  ASSERT_EQ(plp_model_cut(softer.get(), &cut, 1, &next), PLP_OK) << plp_last_error();
  const Owned<plp_model> hollow(next);
  ASSERT_EQ(plp_session_set_model(session.get(), next), PLP_OK) << plp_last_error();
  EXPECT_EQ(rest().label, 0u);
  std::vector<std::uint16_t> left(kVoxels * kVoxels * kVoxels);
  ASSERT_EQ(plp_model_labels(next, left.data(), left.size()), PLP_OK);
  EXPECT_LT(std::count(left.begin(), left.end(), 1), 8 * 12 * 12);

  // neither an earlier version nor another model
  EXPECT_EQ(plp_session_set_model(session.get(), softer.get()), PLP_BAD_INPUT);
  EXPECT_THAT(plp_last_error(), HasSubstr("is not later"));
  EXPECT_EQ(plp_session_set_model(session.get(), Block().model().get()), PLP_BAD_INPUT);
  EXPECT_THAT(plp_last_error(), HasSubstr("another model"));
  EXPECT_EQ(plp_session_set_model(session.get(), hollow.get()), PLP_OK) << "the same version again";
}

TEST(Api, FieldsAndSurfacesAreSampled) {
  const auto model = Block().model();
  const double points[] = {9.5, 9.5, 20, 9.5, 9.5, 13.5, 9.5, 9.5, 12.5};
  double values[3], slopes[9];
  ASSERT_EQ(plp_model_sample(model.get(), PLP_DEFAULT_METHOD, points, 3, values, slopes), PLP_OK)
      << plp_last_error();
  EXPECT_GT(values[0], 1);
  EXPECT_NEAR(values[1], 0, kRounded_mm);
  EXPECT_NEAR(values[2], -1, kRounded_mm);
  EXPECT_NEAR(slopes[5], 1, 1e-3);
  for (int method = PLP_TRILINEAR; method < PLP_PROXY; ++method) {
    ASSERT_EQ(plp_model_sample(model.get(), method, points, 3, values, nullptr), PLP_OK) << plp_last_error();
    EXPECT_EQ(values[0], 0) << method;
    EXPECT_GT(values[2], 0) << method;
  }
}

TEST(Api, SectionsAndPicturesShowTheBlock) {
  const auto model = Block().model();
  plp_section section;
  plp_section_init(&section, sizeof section);
  section.width_px = section.height_px = 20;
  section.width_mm = 20;
  for (double& centre : section.centre_mm) centre = 9.5;
  std::vector<std::uint16_t> labels(400);
  ASSERT_EQ(plp_model_section_labels(model.get(), &section, labels.data(), labels.size()), PLP_OK)
      << plp_last_error();
  EXPECT_EQ(std::count(labels.begin(), labels.end(), 1), 12 * 12);
  std::vector<std::uint8_t> rgb(1200);
  ASSERT_EQ(plp_model_section(model.get(), &section, rgb.data(), rgb.size()), PLP_OK) << plp_last_error();
  EXPECT_GT(rgb[3 * (10 * 20 + 10)], rgb[0]);

  plp_camera camera;
  plp_camera_init(&camera, sizeof camera);
  camera.width_px = camera.height_px = 20;
  camera.width_mm = 20;
  for (double& focus : camera.focus_mm) focus = 9.5;
  std::vector<float> depth_mm(400);
  ASSERT_EQ(plp_model_picture(model.get(), &camera, rgb.data(), rgb.size(), depth_mm.data()), PLP_OK)
      << plp_last_error();
  EXPECT_NEAR(depth_mm[10 * 20 + 10], -6, 1) << "from the front onto j = 3.5";
  EXPECT_TRUE(std::isinf(depth_mm[0]));
  EXPECT_EQ(plp_model_picture(model.get(), &camera, rgb.data(), 7, nullptr), PLP_BAD_INPUT);
  camera.down[0] = 1;
  EXPECT_EQ(plp_model_picture(model.get(), &camera, rgb.data(), rgb.size(), nullptr), PLP_BAD_INPUT);
}

TEST(Api, ASceneByItsNameRunsAsOnTheCommandLine) {
  constexpr const char* kScene = "palpation-block:spacing=2";
  constexpr const char* kScript =
      "[[step]]\napproach = \"plate\"\n[[step]]\npress = 0.5\n[[step]]\nleave = true\n";
  plp_model* loaded = nullptr;
  ASSERT_EQ(plp_model_load(kScene, nullptr, nullptr, &loaded), PLP_OK) << plp_last_error();
  const Owned<plp_model> model(loaded);
  const palpate::test::TemporaryFolder folder;
  const std::string file = (folder / "run.h5").string();
  plp_run_options options;
  plp_run_options_init(&options, sizeof options);
  options.recording = file.c_str();
  options.seed = 7;
  options.script_text = kScript;
  plp_run* made = nullptr;
  ASSERT_EQ(plp_simulate(model.get(), &options, &made), PLP_OK) << plp_last_error();
  const Owned<plp_run> run(made);
  plp_run_info info;
  info.size = sizeof info;
  ASSERT_EQ(plp_run_info_get(made, &info), PLP_OK);

  // the verb calls this function
  const auto scene = load_scene_or_data_set({kScene});
  ASSERT_TRUE(scene.ok());
  SimulationOptions simulation;
  simulation.seed = 7;
  const auto script = parse_script(kScript, "script");
  ASSERT_TRUE(script.ok());
  const auto result = simulate(*scene, *script, simulation, "");
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_EQ(info.run_hash, result->summary.run_hash);
  EXPECT_EQ(info.ticks, result->summary.ticks);
  EXPECT_EQ(info.rate_hz, 1000);

  plp_recording* opened = nullptr;
  ASSERT_EQ(plp_recording_open(file.c_str(), &opened), PLP_OK) << plp_last_error();
  const Owned<plp_recording> recording(opened);
  plp_recording_info reported;
  reported.size = sizeof reported;
  ASSERT_EQ(plp_recording_info_get(opened, &reported), PLP_OK);
  EXPECT_EQ(reported.run_hash, info.run_hash);
  EXPECT_EQ(reported.ticks, info.ticks);
  EXPECT_STREQ(reported.data_set, kScene);
  const std::size_t count = std::min<std::size_t>(info.ticks, 500);
  std::vector<plp_record> of_run(count), of_file(count);
  plp_record_init(&of_run[0], sizeof of_run[0]);
  plp_record_init(&of_file[0], sizeof of_file[0]);
  const std::uint64_t first = info.ticks - count;
  ASSERT_EQ(plp_run_records(made, 0, first, count, of_run.data()), PLP_OK);
  ASSERT_EQ(plp_recording_records(opened, 0, first, count, of_file.data()), PLP_OK) << plp_last_error();
  for (std::size_t n = 0; n < count; ++n) {
    ASSERT_EQ(of_run[n].state_hash, of_file[n].state_hash);
    ASSERT_EQ(of_run[n].force_world_N[2], of_file[n].force_world_N[2]);
  }
  std::vector<double> forces(3 * count), hashes(count);
  ASSERT_EQ(plp_recording_column(opened, 0, "force_world_N", first, count, forces.data()), PLP_OK);
  EXPECT_EQ(forces[3 * count - 1], of_file[count - 1].force_world_N[2]);
  ASSERT_EQ(plp_recording_column(opened, 0, "tick", first, count, hashes.data()), PLP_OK);
  EXPECT_EQ(hashes[0], static_cast<double>(first));
  EXPECT_EQ(plp_recording_column(opened, 0, "nothing", first, count, hashes.data()), PLP_BAD_INPUT);
}

TEST(Api, LoopTicksAndRendersPostedPoses) {
  const auto model = Block().model();
  plp_session_options session;
  plp_session_options_init(&session, sizeof session);
  session.frame = PLP_PATIENT;
  plp_loop_options options;
  plp_loop_options_init(&options, sizeof options);
  options.session = &session;
  plp_loop* started = nullptr;
  ASSERT_EQ(plp_loop_start(model.get(), &options, &started), PLP_OK) << plp_last_error();
  const Owned<plp_loop> loop(started);
  const auto poses = press(1200);
  plp_record record;
  plp_record_init(&record, sizeof record);
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  double most_N = 0;
  for (std::size_t n = 0; most_N < 0.7 && std::chrono::steady_clock::now() < deadline; n += 5) {
    ASSERT_EQ(plp_loop_post(started, &poses[std::min(n, poses.size() - 1)]), PLP_OK) << plp_last_error();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    ASSERT_EQ(plp_loop_snapshot(started, &record), PLP_OK);
    most_N = std::max(most_N, record.force_world_N[1]);
  }
  EXPECT_GE(most_N, 0.7);
  plp_loop_health health;
  health.size = sizeof health;
  ASSERT_EQ(plp_loop_health_get(started, &health), PLP_OK);
  EXPECT_NE(health.running, 0);
  EXPECT_GT(health.ticks, 100u);

  plp_pose nowhere = poses[0];
  nowhere.tip_mm[1] = std::nan("");
  EXPECT_EQ(plp_loop_post(started, &nowhere), PLP_BAD_INPUT);
  ASSERT_EQ(plp_loop_emergency_stop(started), PLP_OK);
  const std::uint64_t stopped_at = record.tick;
  do ASSERT_EQ(plp_loop_snapshot(started, &record), PLP_OK);
  while (record.tick < stopped_at + 5);
  EXPECT_EQ(record.force_world_N[1], 0);
  ASSERT_EQ(plp_loop_stop(started), PLP_OK);
  ASSERT_EQ(plp_loop_health_get(started, &health), PLP_OK);
  EXPECT_EQ(health.running, 0);
}

TEST(Api, HandlesComeAndGo) {
  const Block block;
  const auto poses = press(3);
  for (int n = 0; n < 60; ++n) {
    const auto model = block.model();
    const auto session = session_of(model.get(), n % 2 == 0 ? PLP_WORLD : PLP_PATIENT);
    ASSERT_EQ(plp_session_run(session.get(), poses.data(), poses.size(), kTick_s, nullptr, nullptr), PLP_OK);
  }
  // a session outlives its model
  auto model = block.model();
  for (int n = 0; n < 10'000; ++n) ASSERT_NE(session_of(model.get()), nullptr);
  const auto session = session_of(model.get());
  model.reset();
  ASSERT_EQ(plp_session_run(session.get(), poses.data(), poses.size(), kTick_s, nullptr, nullptr), PLP_OK);
}

// a flag that is set cancels the next long call, and one that is not set does not
TEST(Cancellation, CancelFlagEndsALongCall) {
  const Block block;
  std::uint8_t flag = 1;
  plp_set_cancel_flag(&flag);
  plp_model* model = nullptr;
  EXPECT_EQ(plp_model_load("knee-phantom:spacing=3", nullptr, nullptr, &model), PLP_INTERRUPTED);
  EXPECT_EQ(model, nullptr);
  // another thread has none
  std::thread([] {
    plp_model* other = nullptr;
    EXPECT_EQ(plp_model_load("knee-phantom:spacing=3", nullptr, nullptr, &other), PLP_OK);
    plp_model_destroy(other);
  }).join();
  flag = 0;
  EXPECT_EQ(plp_model_load("knee-phantom:spacing=3", nullptr, nullptr, &model), PLP_OK);
  plp_model_destroy(model);
  plp_set_cancel_flag(nullptr);
}

}  // namespace
}  // namespace palpate::c::test
