#include "verbs.h"

#include "verb.h"

namespace palpate::app {
namespace {

constexpr const char* kExamples =
    "Examples:\n"
    "  palpate info knee.seg.nrrd                       show the contents of a file\n"
    "  palpate simulate knee-phantom --report run.html  palpate a generated knee\n"
    "  palpate explore knee-phantom                     the same in real time\n"
    "  palpate section labels.nii.gz -o three.png       section through your own data\n"
    "  palpate scene new scan.nii.gz labels.nii.gz -o scene.toml\n"
    "  palpate simulate scene.toml -o run.h5            palpate your own data\n"
    "  palpate help simulate                            options of a verb\n\n"
    "Exit codes: 0 success; 1 a file or setting cannot be used, or doctor found a requirement missing; 2 "
    "wrong\n"
    "command line; 3 a figure exceeds its limit, a replay differs, a script step failed, or lint found a\n"
    "fault; 4 a result could not be written; 5 a data set, a device or the network is unavailable;\n"
    "130 interrupted.\n\n"
    "Research and education, not for clinical use.";

// commands of other programs, with the corresponding command of palpate
constexpr VerbAlias kOtherWords[] = {
    {"import", "palpate scene new SCAN LABELS -o scene.toml"},
    {"new", "palpate scene new SCAN LABELS -o scene.toml"},
    {"create", "palpate scene new SCAN LABELS -o scene.toml"},
    {"init", "palpate scene new SCAN LABELS -o scene.toml"},
    {"add", "palpate scene new SCAN LABELS -o scene.toml"},
    {"check", "palpate scene check SCENE"},
    {"validate", "palpate scene check SCENE, or palpate lint LABELS"},
    {"quality", "palpate lint LABELS"},
    {"faults", "palpate lint LABELS"},
    {"clean", "palpate lint LABELS --fix NEW.seg.nrrd"},
    {"open", "palpate explore FILE"},
    {"load", "palpate explore FILE"},
    {"start", "palpate explore FILE"},
    {"feel", "palpate explore FILE"},
    {"touch", "palpate explore FILE"},
    {"palpate", "palpate explore FILE"},
    {"serve", "palpate explore FILE"},
    {"view",
     "palpate explore FILE, palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"show",
     "palpate explore FILE, palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"display",
     "palpate explore FILE, palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"viewer",
     "palpate explore FILE, palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"draw", "palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"plot", "palpate section FILE -o picture.png"},
    {"picture", "palpate section FILE -o picture.png, or palpate render FILE -o picture.png"},
    {"slice", "palpate section FILE -o picture.png"},
    {"run", "palpate simulate FILE"},
    {"press", "palpate simulate FILE"},
    {"record", "palpate simulate FILE -o run.h5, or palpate explore FILE -o run.h5"},
    {"play", "palpate replay RECORDING"},
    {"rerun", "palpate replay RECORDING"},
    {"convert", "palpate prepare FILE -o field.nrrd; other formats are converted by 3D Slicer or dcm2niix"},
    {"export", "palpate prepare FILE -o field.nrrd, or palpate report RECORDING"},
    {"list", "palpate data list"},
    {"ls", "palpate data list"},
    {"download", "palpate data fetch NAME"},
    {"fetch", "palpate data fetch NAME"},
    {"get", "palpate data fetch NAME"},
    {"demo", "palpate simulate knee-phantom --report run.html"},
    {"inspect", "palpate info FILE"},
    {"describe", "palpate info FILE"},
    {"labels", "palpate info FILE"},
    {"test", "palpate verify accuracy"},
    {"diagnose", "palpate doctor"},
    {"diagnostics", "palpate doctor"},
    {"setup", "palpate doctor"},
    {"bench", "palpate verify latency"},
    {"learners", "palpate records list"},
    {"scores", "palpate records list"},
    {"score", "palpate task score RECORDING --task TASK"},
    {"grade", "palpate task score RECORDING --task TASK"},
    {"tasks", "palpate task list"},
    {"rehearse", "palpate plan compare RECORDING --plan PLAN"},
    {"rehearsal", "palpate plan compare RECORDING --plan PLAN"},
    {"training", "palpate task list"},
    {"calibrate", "palpate task calibrate RECORDING... --task TASK"},
    {"password", "palpate token"},
    {"version", "palpate --version"},
};

}  // namespace

const Program& palpate_program() {
  static const Program program{
      kExamples,
      {add_info,   add_data,  add_cache,   add_scene,  add_lint,     add_prepare, add_fit,
       add_forces, add_hold,  add_section, add_render, add_simulate, add_explore, add_devices,
       add_doctor, add_token, add_replay,  add_export, add_report,   add_cohort,  add_register,
       add_pivot,  add_plan,  add_task,    add_records},
      {{"verify", "Measure this build on this machine and compare the figures with their limits"}},
      kOtherWords};
  return program;
}

int run(const std::vector<std::string>& arguments, const Streams& streams) {
  return run(palpate_program(), arguments, streams);
}

}  // namespace palpate::app
