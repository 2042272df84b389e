#include <cstdio>
#include <memory>

#include "palpate/server/viewer_tokens.h"
#include "verb.h"

namespace palpate::app {
namespace {

struct TokenOptions {
  std::filesystem::path file;
  NewTokens wanted;
};

int make_tokens(const TokenOptions& options, Console& console) {
  const auto lines = new_viewer_tokens(options.wanted);
  if (!lines) return console.fail(lines.error());
  if (options.file.empty()) {
    std::fputs(lines->c_str(), stdout);
    return kExitOk;
  }
  if (const auto written = write_viewer_tokens(options.file, *lines); !written)
    return console.fail(written.error());
  console.note("palpate explore --token-file " + options.file.string() + " reads them");
  return kExitOk;
}

}  // namespace

void add_token(CLI::App& app, Run& run) {
  CLI::App* verb = app.add_subcommand("token", "Create tokens for viewers on other machines");
  const auto options = std::make_shared<TokenOptions>();
  verb->add_option("--role", options->wanted.role,
                   "Print one line for this role; default: one line for control and one for view")
      ->check(CLI::IsMember({"view", "control", "learner", "teacher"}));
  verb->add_option("--learner", options->wanted.learner, "With --role learner: pseudonym of the learner");
  verb->add_option("-o,--output", options->file,
                   "New file to write, readable only by you; default: standard output")
      ->type_name("FILE");
  verb->footer(
      "Prints lines for `palpate explore --token-file FILE`: without --role two, one for control and one "
      "for\n"
      "view. Each token has 26 characters from the kernel's random number generator (130 bits).\n"
      "Permissions of each role: docs/reference/viewer-protocol.md.\n\n"
      "Examples:\n"
      "  palpate token -o tokens\n"
      "  palpate explore knee-phantom --listen 0.0.0.0 --token-file tokens --tls-cert C.pem --tls-key K.pem\n"
      "  palpate token --role teacher -o class\n"
      "  palpate token --role learner --learner L042 >> class");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return make_tokens(*options, console); }; });
}

}  // namespace palpate::app
