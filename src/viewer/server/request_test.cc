#include "server/request.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "server/flat_json.h"

namespace palpate::server {
namespace {

template <class T>
std::optional<T> parsed(std::string_view text) {
  const auto message = parse_viewer_message(text);
  if (!message) return std::nullopt;
  if constexpr (std::is_same_v<T, Hello> || std::is_same_v<T, TipMessage> || std::is_same_v<T, Request>) {
    const auto* found = std::get_if<T>(&*message);
    return found ? std::optional(*found) : std::nullopt;
  } else {
    const auto* request = std::get_if<Request>(&*message);
    const auto* found = request ? std::get_if<T>(&request->body) : nullptr;
    return found ? std::optional(*found) : std::nullopt;
  }
}

// `where` of the refusal; "-" if the request is not refused
std::string refused_at(std::string_view text) {
  const auto error = parsed<Error>(text);
  return error ? error->where : "-";
}

TEST(Request, HelloHasOptionalSubscriptions) {
  const auto hello = parsed<Hello>(R"({"type": "hello", "protocol": 3, "token": "abc", "poses_hz": 120})");
  ASSERT_TRUE(hello);
  EXPECT_EQ(hello->protocol, 3);
  EXPECT_EQ(hello->token, "abc");
  EXPECT_EQ(hello->poses_hz, 120);
  EXPECT_FALSE(hello->wants_deformation);
  EXPECT_EQ(parsed<Hello>(R"({"type": "hello", "protocol": 3})")->poses_hz, 60);
  EXPECT_TRUE(parsed<Hello>(R"({"type": "hello", "protocol": 3, "yielded": true})")->wants_deformation);
  EXPECT_FALSE(hello->wants_task);
  EXPECT_FALSE(hello->wants_distances);
  EXPECT_FALSE(hello->wants_navigation);
  EXPECT_FALSE(hello->wants_ticks);
  EXPECT_TRUE(parsed<Hello>(R"({"type": "hello", "protocol": 3, "ticks": true})")->wants_ticks);
  EXPECT_FALSE(hello->wants_plan);
  EXPECT_TRUE(parsed<Hello>(R"({"type": "hello", "protocol": 3, "plan": true})")->wants_plan);
  EXPECT_TRUE(parsed<Hello>(R"({"type": "hello", "protocol": 3, "near": true})")->wants_distances);
  EXPECT_TRUE(parsed<Hello>(R"({"type": "hello", "protocol": 3, "navigation": true})")->wants_navigation);
  EXPECT_TRUE(parsed<Hello>(R"({"type": "hello", "protocol": 3, "task": true})")->wants_task);
}

TEST(Request, TaskBeginsAndEnds) {
  const auto begin = parsed<TaskRequest>(R"({"type": "task", "id": 8, "begin": "hold-steady"})");
  ASSERT_TRUE(begin);
  EXPECT_EQ(begin->begin, "hold-steady");
  EXPECT_FALSE(begin->end);
  const auto end = parsed<TaskRequest>(R"({"type": "task", "id": 9, "end": true})");
  ASSERT_TRUE(end);
  EXPECT_FALSE(end->begin);
  EXPECT_TRUE(end->end);
  EXPECT_EQ(refused_at(R"({"type": "task", "id": 9})"), "");
  EXPECT_EQ(refused_at(R"({"type": "task", "id": 9, "end": false})"), "");
  EXPECT_EQ(refused_at(R"({"type": "task", "id": 9, "begin": "a", "end": true})"), "");
  EXPECT_EQ(refused_at(R"({"type": "task", "id": 9, "begin": 7})"), "begin");
  EXPECT_EQ(refused_at(R"({"type": "task", "id": 9, "begin": "a", "learner": "x"})"), "");
  EXPECT_EQ(refused_at(R"({"type": "task", "id": 9, "begin": ")" + std::string(257, 'a') + "\"}"), "begin");
  EXPECT_FALSE(parsed<Request>(R"({"type": "task", "begin": "a"})")) << "no id";
}

TEST(Request, LessonSetsLearnerTaskAndNames) {
  const auto lesson =
      parsed<LessonRequest>(R"({"type": "lesson", "id": 9, "learner": "L042", "task": "", "names": false})");
  ASSERT_TRUE(lesson);
  EXPECT_EQ(lesson->learner, "L042");
  EXPECT_EQ(lesson->task, "");
  EXPECT_EQ(lesson->names, false);
  EXPECT_FALSE(lesson->pointer);
  EXPECT_FALSE(lesson->end);
  EXPECT_EQ(refused_at(R"({"type": "lesson", "id": 9})"), "");
  EXPECT_EQ(refused_at(R"({"type": "lesson", "id": 9, "end": false})"), "");
  EXPECT_EQ(refused_at(R"({"type": "lesson", "id": 9, "names": "yes"})"), "names");
  EXPECT_EQ(refused_at(R"({"type": "lesson", "id": 9, "erase": "L042"})"), "");
  EXPECT_EQ(refused_at(R"({"type": "lesson", "id": 9, "learner": ")" + std::string(65, 'a') + "\"}"),
            "learner");
}

TEST(Request, SetChangesSettings) {
  const auto set = parsed<SettingsRequest>(
      R"({"type": "set", "id": 1, "method": "trilinear", "law": "chainmail", "friction": false, "viscosity": true, "passivity": true,
          "paused": true, "max_force_N": 1.0, "rotation_wxyz": [0, 1, 0, 0]})");
  ASSERT_TRUE(set);
  EXPECT_EQ(set->method, "trilinear");
  EXPECT_EQ(set->law, "chainmail");
  EXPECT_EQ(set->friction, false);
  EXPECT_EQ(set->viscosity, true);
  EXPECT_EQ(set->passivity, true);
  EXPECT_EQ(set->paused, true);
  EXPECT_EQ(set->max_force_N, 1);
  EXPECT_EQ(set->rotation_wxyz, (std::array<double, 4>{0, 1, 0, 0}));
}

TEST(Request, TissueChangesContactProperties) {
  const auto tissue = parsed<TissueRequest>(
      R"({"type": "tissue", "id": 2, "tissue": 3, "stiffness_N_per_mm": 0.8, "static_friction": 0.3,
          "friction": 0.2, "viscosity_N_s_per_mm": 0})");
  ASSERT_TRUE(tissue);
  EXPECT_EQ(tissue->tissue, 3);
  EXPECT_EQ(tissue->changes.applied_to({}), (ContactProperties{0.8, 0.3, 0.2, 0}));
}

TEST(Request, StrokesAreUndoneAndRedone) {
  EXPECT_EQ(parsed<StrokeRequest>(R"({"type": "undo", "id": 8})")->action, StrokeAction::kUndo);
  EXPECT_EQ(parsed<StrokeRequest>(R"({"type": "redo", "id": 8})")->action, StrokeAction::kRedo);
  EXPECT_EQ(refused_at(R"({"type": "undo", "id": 8, "stroke": 1})"), "");
}

TEST(Request, StopHasNoFields) {
  EXPECT_TRUE(parsed<StopRequest>(R"({"type": "stop", "id": 3})"));
}

TEST(Request, RearmNamesItsStop) {
  EXPECT_EQ(parsed<RearmRequest>(R"({"type": "rearm", "id": 4, "stop": 7})")->stop, 7u);
  EXPECT_EQ(parsed<RearmRequest>(R"({"type": "rearm", "id": 4, "stop": 7})")->code, "");
  EXPECT_EQ(parsed<RearmRequest>(R"({"type": "rearm", "id": 4, "stop": 7, "code": "012345"})")->code,
            "012345");
}

TEST(Request, PointerIsTaken) {
  EXPECT_TRUE(parsed<PointerRequest>(R"({"type": "pointer", "id": 5, "take": true})")->take);
}

TEST(Request, PlaySetsPositionAndSpeed) {
  const auto play =
      parsed<PlayRequest>(R"({"type": "play", "id": 6, "at_s": 12.5, "playing": true, "speed": -2})");
  ASSERT_TRUE(play);
  EXPECT_EQ(play->at_s, 12.5);
  EXPECT_EQ(play->playing, true);
  EXPECT_EQ(play->speed, -2);
}

TEST(Request, TipHasATargetUntilItIsLifted) {
  const auto tip = parsed<TipMessage>(R"({"type": "tip", "patient_mm": [1, -2.5, 3e1]})");
  ASSERT_TRUE(tip && tip->target);
  EXPECT_EQ(tip->target->tip_patient_mm, (std::array<double, 3>{1, -2.5, 30}));
  EXPECT_EQ(tip->target->force_N, 0);
  const auto press = parsed<TipMessage>(
      R"({"type": "tip", "patient_mm": [1, 2, 3], "into": [0, 0.6, -0.8], "force_N": 0.5})");
  ASSERT_TRUE(press && press->target);
  EXPECT_NEAR(press->target->into[2], -0.8, 1e-12);
  EXPECT_EQ(press->target->force_N, 0.5);
  EXPECT_FALSE(press->target->set_down);
  const auto set_down = parsed<TipMessage>(R"({"type": "tip", "patient_mm": [1, 2, 3], "set_down": true})");
  ASSERT_TRUE(set_down && set_down->target);
  EXPECT_TRUE(set_down->target->set_down);
  const auto lift = parsed<TipMessage>(R"({"type": "lift"})");
  ASSERT_TRUE(lift);
  EXPECT_FALSE(lift->target);
}

TEST(Request, IdsHaveFiftyThreeBits) {
  EXPECT_EQ(parsed<Request>(R"({"type": "rearm", "id": 9007199254740991, "stop": 4294967295})")->id,
            9007199254740991);
}

TEST(Request, WrongValuesAreRefusedByTheirKey) {
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"max_force_N":"1"})"), "max_force_N");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"max_force_N":true})"), "max_force_N");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"max_force_N":[1]})"), "max_force_N");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"friction":1})"), "friction");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"method":1})"), "method");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"method":")" + std::string(65, 'm') + "\"}"), "method");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1})"), "");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"friction":true,"secret":1})"), "");
  EXPECT_EQ(refused_at(R"({"type":"tissue","id":1,"stiffness_N_per_mm":1})"), "tissue");
  EXPECT_EQ(refused_at(R"({"type":"tissue","id":1,"tissue":1.5,"stiffness_N_per_mm":1})"), "tissue");
  EXPECT_EQ(refused_at(R"({"type":"tissue","id":1,"tissue":-1,"stiffness_N_per_mm":1})"), "tissue");
  EXPECT_EQ(refused_at(R"({"type":"tissue","id":1,"tissue":99999999999,"stiffness_N_per_mm":1})"), "tissue");
  EXPECT_EQ(refused_at(R"({"type":"tissue","id":1,"tissue":1})"), "");
  EXPECT_EQ(refused_at(R"({"type":"play","id":1,"speed":0})"), "speed");
  EXPECT_EQ(refused_at(R"({"type":"play","id":1,"speed":33})"), "speed");
  EXPECT_EQ(refused_at(R"({"type":"play","id":1,"speed":-0.001})"), "speed");
  EXPECT_EQ(refused_at(R"({"type":"play","id":1,"at_s":"now"})"), "at_s");
  EXPECT_EQ(refused_at(R"({"type":"play","id":1})"), "");
  EXPECT_EQ(refused_at(R"({"type":"pointer","id":1})"), "take");
  EXPECT_EQ(refused_at(R"({"type":"pointer","id":1,"take":"yes"})"), "take");
  EXPECT_EQ(refused_at(R"({"type":"rearm","id":1,"stop":1,"more":1})"), "");
  EXPECT_EQ(refused_at(R"({"type":"rearm","id":1})"), "stop");
  EXPECT_EQ(refused_at(R"({"type":"rearm","id":1,"stop":1,"code":12})"), "code");
  EXPECT_EQ(refused_at(R"({"type":"rearm","id":1,"stop":1,"code":"01234567890123456"})"), "code");
  EXPECT_EQ(refused_at(R"({"type":"rearm","id":1,"stop":-1})"), "stop");
  EXPECT_EQ(refused_at(R"({"type":"rearm","id":1,"stop":4294967296})"), "stop");
  EXPECT_EQ(refused_at(R"({"type":"format the disk","id":1})"), "type");
}

TEST(Request, RotationsAreUnitQuaternions) {
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"rotation_wxyz":[0,0,0,0]})"), "rotation_wxyz");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"rotation_wxyz":[1,1,0,0]})"), "rotation_wxyz");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"rotation_wxyz":[1e200,1e200,0,0]})"), "rotation_wxyz");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"rotation_wxyz":[1,0,0]})"), "rotation_wxyz");
  EXPECT_EQ(refused_at(R"({"type":"set","id":1,"rotation_wxyz":[1,0,0,0,0]})"), "rotation_wxyz");
  // a quaternion in single precision is accepted and normalised
  const auto set = parsed<SettingsRequest>(R"({"type":"set","id":1,"rotation_wxyz":[0.70711,0.70711,0,0]})");
  ASSERT_TRUE(set && set->rotation_wxyz);
  const auto& q = *set->rotation_wxyz;
  EXPECT_NEAR(q[0] * q[0] + q[1] * q[1], 1, 1e-15);
}

TEST(Request, AStopIsOneHoweverItIsAskedFor) {
  EXPECT_TRUE(parsed<StopRequest>(R"({"type":"stop"})"));
  EXPECT_TRUE(parsed<StopRequest>(R"({"type":"stop","id":"x"})"));
  EXPECT_TRUE(parsed<StopRequest>(R"({"type":"stop","id":1,"because":"it hurts"})"));
  for (const char* text : {R"([{"type":"stop"}])", R"({"type":"stop")", R"({"type":"stop"}x)",
                           R"({"type" : "stop", "id": null})", R"({"type":"stop","type":"stop"})",
                           "{\"type\":\n\"stop\",\"m\":\"\xff\xfe\"}", R"(type: 1, "type":"stop")"}) {
    const auto stop = parsed<Request>(text);
    ASSERT_TRUE(stop && is_stop(*stop)) << text;
    EXPECT_EQ(stop->id, 0);
  }
  for (const char* text : {R"({"type":"tip","m":"\"type\":\"stop\""})", R"({"types":"stop")",
                           R"({"type":"stopped")", R"("stop")", R"({"type":)", R"({"type")"})
    EXPECT_FALSE(is_stop(parse_viewer_message(text))) << text;
}

TEST(Request, RejectsMalformedMessages) {
  for (const char* text : {
           "",
           " ",
           "null",
           "1",
           "\"stop\"",
           "[]",
           "[{\"type\":\"rearm\"}]",
           "{",
           "{}",
           "{}{}",
           "{\"type\":\"rearm\"}x",
           R"({"id":1})",
           R"({"type":1,"id":1})",
           R"({"type":"set","friction":true})",
           R"({"type":"set","id":1.5,"friction":true})",
           R"({"type":"set","id":-1,"friction":true})",
           R"({"type":"set","id":9007199254740992,"friction":true})",
           R"({"type":"set","id":1e3,"friction":true})",
           // duplicate key
           R"({"type":"set","id":1,"friction":true,"friction":false})",
           R"({"type":"rearm","type":"rearm"})",
           // numbers that are out of range or that JSON does not have
           R"({"type":"set","id":1,"max_force_N":1e999})",
           R"({"type":"set","id":1,"max_force_N":NaN})",
           R"({"type":"tip","patient_mm":[1,2,Infinity]})",
           R"({"type":"tip","patient_mm":[1,2,1e999]})",
           R"({"type":"tip","patient_mm":[1,2,3],"into":[0,0,1]})",
           R"({"type":"tip","patient_mm":[1,2,3],"force_N":1})",
           R"({"type":"tip","patient_mm":[1,2,3],"into":[0,0,2],"force_N":1})",
           R"({"type":"tip","patient_mm":[1,2,3],"into":[0,0,1],"force_N":0})",
           R"({"type":"tip","patient_mm":[1,2,3],"into":[0,0,1],"force_N":41})",
           R"({"type":"tip","patient_mm":[1,2,3],"set_down":1})",
           R"({"type":"lift","patient_mm":[1,2,3]})",
           // nested values
           R"({"type":"set","id":1,"method":{"a":1}})",
           R"({"type":"set","id":1,"rotation_wxyz":[[1],0,0,0]})",
           R"({"type":"set","id":1,"rotation_wxyz":["1",0,0,0]})",
           R"({"type":"set","id":1,"friction":null})",
           // tips and hellos have no answer
           R"({"type":"tip"})",
           R"({"type":"tip","patient_mm":[1,2]})",
           R"({"type":"tip","patient_mm":"1 2 3"})",
           R"({"type":"tip","patient_mm":[1,2,3],"id":1})",
           R"({"type":"hello"})",
           R"({"type":"hello","protocol":3,"poses_hz":0})",
           R"({"type":"hello","protocol":3,"yielded":1})",
           R"({"type":"hello","protocol":3,"poses_hz":121})",
           R"({"type":"hello","protocol":"1"})",
           R"({"type":"hello","protocol":3,"token":1})",
           R"({"type":"hello","protocol":3,"admin":true})",
       })
    EXPECT_FALSE(parse_viewer_message(text)) << text;
  EXPECT_FALSE(parse_viewer_message(std::string_view("{\"type\":\"rearm\",\"id\":1}\0", 24)));
  EXPECT_FALSE(parse_viewer_message("{\"type\":\"rearm\",\"id\":1,\"m\":\"\xff\xfe\"}"));
}

TEST(Request, DepthAndLengthCostNothing) {
  const std::string deep(kMaxMessage_bytes, '[');
  EXPECT_FALSE(parse_viewer_message(deep));
  std::string objects;
  while (objects.size() + 6 < kMaxMessage_bytes) objects += R"({"a":)";
  EXPECT_FALSE(parse_viewer_message(objects));
  // not bounded by the caller here: still no recursion
  EXPECT_FALSE(parse_flat_json(std::string(10'000'000, '[')));
  const std::string rearm = R"({"type":"rearm","id":1})";
  EXPECT_TRUE(parse_viewer_message(rearm + std::string(kMaxMessage_bytes - rearm.size(), ' ')));
  EXPECT_FALSE(parse_viewer_message(rearm + std::string(kMaxMessage_bytes - rearm.size() + 1, ' ')));
}

// no text of the viewer appears in a refusal
TEST(Request, RefusalsRepeatNothing) {
  for (const char* text : {R"({"type":"DOE^CANARY","id":1})", R"({"type":"set","id":1,"DOE^CANARY":1})",
                           R"({"type":"set","id":1,"max_force_N":"DOE^CANARY"})"}) {
    const auto error = parsed<Error>(text);
    ASSERT_TRUE(error) << text;
    EXPECT_EQ(error->message().find("CANARY"), std::string::npos);
  }
}

TEST(Request, AnyDamageGivesAMessageOrNone) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE(seed);
  std::mt19937 random(seed);
  const std::string whole =
      R"({"type":"set","id":7,"method":"proxy","max_force_N":1.5,"rotation_wxyz":[1,0,0,0],"paused":false})";
  int messages = 0;
  for (int n = 0; n < 20000; ++n) {
    std::string text = whole;
    for (int damage = 0; damage < 3; ++damage) text[random() % text.size()] = static_cast<char>(random());
    const auto message = parse_viewer_message(text);
    if (!message) continue;
    ++messages;
    const auto* request = std::get_if<Request>(&*message);
    const auto* set = request ? std::get_if<SettingsRequest>(&request->body) : nullptr;
    EXPECT_TRUE(!set || !set->max_force_N || std::isfinite(*set->max_force_N)) << text;
    if (!set || !set->rotation_wxyz) continue;
    double square = 0;
    for (const double component : *set->rotation_wxyz) square += component * component;
    EXPECT_NEAR(square, 1, 1e-12) << text;
  }
  EXPECT_GT(messages, 0);
}

}  // namespace
}  // namespace palpate::server
