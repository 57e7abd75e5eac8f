#include "processing/app/encode_options.h"

#include <charconv>
#include <map>

namespace mesorig::processing {
namespace {

using codecs::Quantisation;
using codecs::Weighting;

// "4" or "all".
std::string SetTerms(const std::string& text, int& terms) {
  if (text == "all") {
    terms = codecs::kAllTerms;
    return {};
  }
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), terms);
  if (error == std::errc() && end == text.data() + text.size() && terms >= 1) return {};
  return "`" + text + "` is neither a number >= 1 nor `all`";
}

}  // namespace

void AddNegativeOption(CLI::App* command, bool& clamp_negative) {
  static const std::map<std::string, bool> policies = {{"keep", false}, {"clamp", true}};
  command
      ->add_option("--negative", clamp_negative,
                   "what decodes below zero: keep it (errors stay linear), or clamp it at zero; its "
                   "mass is reported either way")
      ->transform(CLI::Transformer(policies))
      ->type_name("keep|clamp");
}

void AddEncodeOptions(CLI::App* command, codecs::EncodeOptions& options) {
  command
      ->add_option_function<std::string>(
          "--terms", [&options](const std::string& text) {
            if (const std::string problem = SetTerms(text, options.terms); !problem.empty()) {
              throw CLI::ValidationError("--terms", problem);
            }
          },
          "terms of a factorisation, or `all`")
      ->type_name("N|all");
  command->add_option("--regularisation", options.regularisation,
                      "weight of the codec's prior, in lights (rf-ptm: 0.01)")
      ->check(CLI::Range(0.0, 1e6));
  command->add_option("--clusters", options.clusters, "clusters of texels (pcmf: 32, cmf: none)")
      ->check(CLI::Range(1, 2048));
  static const std::map<std::string, Weighting> weightings = {
      {"linear", Weighting::kLinear}, {"log", Weighting::kLog}, {"relative", Weighting::kRelative}};
  command->add_option("--weighting", options.weighting, "which error is made smallest")
      ->transform(CLI::Transformer(weightings))
      ->type_name("linear|log|relative");
  command->add_option("--floor", options.floor,
                      "of log and relative, in the file's unit; without it a hundredth of the RMS")
      ->check(CLI::PositiveNumber);
  command->add_flag("--solid-angle", options.solid_angle,
                    "pairs weigh by the solid angle that their directions stand for");
  command->add_flag("--variance", options.variance,
                    "samples weigh by the inverse of the variances that the file holds");
  AddNegativeOption(command, options.clamp_negative);
  command
      ->add_option_function<std::string>(
          "--quantise", [&options](const std::string& text) {
            for (const Quantisation q : {Quantisation::kHalf, Quantisation::kFloat, Quantisation::kByte}) {
              if (text == codecs::NameOf(q)) options.quantisation = q;
            }
            if (!options.quantisation) {
              throw CLI::ValidationError("--quantise", "`" + text + "` is none of half, float, 8bit");
            }
          },
          "how factors are stored")
      ->type_name("half|float|8bit");
}

}  // namespace mesorig::processing
