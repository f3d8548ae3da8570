#include "tools/extract_surface.h"

#include <fmt/format.h>

#include <algorithm>

#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/storage/lowercase.h"
#include "isobrick/storage/remote_options.h"
#include "tools/command.h"
#include "tools/interrupt.h"
#include "tools/outputs.h"
#include "tools/plain_text.h"

namespace isobrick {
namespace {

MeshFileOptions fileOptionsOf(const ExtractArguments& arguments, const Pyramid& pyramid,
                              const SurfaceAttributes& attributes) {
  MeshFileOptions options = meshFileOptions(arguments, &pyramid.spec());
  options.attributes = attributes.attributes;
  options.colors = attributes.colors;
  return options;
}

bool numbersComponents(const ExtractArguments& arguments) {
  return std::ranges::any_of(arguments.attributes, [](const AttributeOptions& attribute) {
    return attribute.kind == AttributeOptions::Kind::kComponent;
  });
}

// The surface is there, and nothing of it is asked for.
void warnOfEmptyChoice(const ExtractArguments& arguments, const ExtractResult& result) {
  std::string why = "at the level and places that are asked for; ask for a finer level";
  if (result.components && !result.components->list().empty())
    why = fmt::format("left: the largest area of its {} pieces, {:.6g}, is below --drop-below",
                      countText(result.components->list().size()),
                      result.components->list().front().area);
  else if (arguments.query.box)
    why = "in --box";
  else if (!arguments.query.region.isEverywhere())
    why = "within --mask, --clip and --sphere";
  else if (arguments.drop_small)
    why = "left by --drop-small";
  fmt::print(stderr, "isobrick: warning: the mesh is empty: nothing of the surface at {} is {}\n",
             result.isovalue, why);
}

}  // namespace

std::vector<std::string> meshNames(const ExtractArguments& arguments) {
  const std::vector<std::optional<double>>& isovalues = arguments.query.isovalues;
  if (arguments.output.empty() || isovalues.size() == 1 || arguments.together)
    return std::vector<std::string>(isovalues.size(), arguments.output);
  std::vector<std::string> names;
  for (const std::optional<double>& isovalue : isovalues)
    names.push_back(isovalue ? nameWith(arguments.output, fmt::format("{}", *isovalue))
                             : std::string());
  return names;
}

void refuseOutputs(const ExtractArguments& arguments) {
  std::vector<std::string> inputs = arguments.query.region.files();
  inputs.insert(inputs.end(), {arguments.query.input.path, arguments.query.input.pyramid});
  for (const AttributeOptions& attribute : arguments.attributes)
    inputs.insert(inputs.end(), {attribute.input.path, attribute.input.pyramid});
  for (const std::string& name : meshNames(arguments))
    if (!name.empty()) refuseReplacing({name}, inputs, arguments.force);
}

std::vector<AttributeFacts> attributeFacts(const ExtractArguments& arguments) {
  std::vector<AttributeFacts> facts;
  for (const AttributeOptions& attribute : arguments.attributes)
    facts.push_back({attribute.name, attribute.input.path});
  return facts;
}

bool isShareName(const std::string& output) { return lowerExtension(output) == kMeshShareEnding; }

MeshCollection* collectionOf(ExtractArguments& arguments, const Pyramid& pyramid,
                             AttributeFields& fields) {
  if (!arguments.together || arguments.collection != nullptr) return arguments.collection.get();
  if (arguments.label && !arguments.attributes.empty())
    throw UsageError(
        "--together of labels gives each vertex its label, and no other --attribute; leave one of "
        "them out");
  if (std::ranges::any_of(arguments.attributes, &AttributeOptions::isOfSurface))
    throw UsageError(
        "--together goes with attributes that are the same field for all surfaces; leave out "
        "thickness and distance, or --together");
  const auto attributes = fields.of(arguments.query, &pyramid, nullptr);
  const auto make = arguments.label ? makeLabelCollection : makeMeshCollection;
  arguments.collection = make(arguments.output, fileOptionsOf(arguments, pyramid, attributes));
  return arguments.collection.get();
}

MeshObject objectOf(const ExtractArguments& arguments, std::size_t surface) {
  MeshObject object;
  object.label = arguments.label.value_or(0);
  object.name = arguments.label ? fmt::format("label {}", object.label)
                                : fmt::format("isovalue {}", *arguments.query.isovalues[surface]);
  if (!arguments.colors.empty()) object.color = arguments.colors[surface];
  return object;
}

ExtractedSurface::ExtractedSurface(const ExtractArguments& arguments, const Pyramid& pyramid,
                                   SurfaceAttributes attributes, std::string output,
                                   ProgressBar& bar)
    : arguments_(arguments),
      pyramid_(pyramid),
      attributes_(std::move(attributes)),
      bar_(bar),
      isovalue_(arguments.query.isovalue),
      query_(makeQuery(arguments.query, pyramid)) {
  if (arguments.drop_small) {
    if (!query_.simplify) query_.simplify.emplace();
    query_.simplify->drop_small = true;
  }
  result_.output = std::move(output);
  result_.isovalue = isovalue_;
  result_.missing_voxels = pyramid.missingVoxels();
  result_.placement = fileOptionsOf(arguments, pyramid, attributes_).placement;
  for (const PyramidValues* const values : attributes_.sampled)
    outside_before_.push_back(values != nullptr ? values->outside() : 0);
}

bool ExtractedSurface::wantsComponents() const {
  return arguments_.list_components || arguments_.keep_largest || arguments_.drop_below ||
         numbersComponents(arguments_);
}

TriangleSink& ExtractedSurface::measured(TriangleSink& sink) {
  watch_ = Stopwatch();
  measured_.emplace(sink, bar_);
  return *measured_;
}

TriangleSink& ExtractedSurface::componentSink() {
  finder_ = std::make_unique<ComponentFinder>(query_);
  return measured(*finder_);
}

void ExtractedSurface::endComponents() {
  result_.components = finder_->take();
  const SurfaceComponents& all = *result_.components;
  result_.is_kept = all.kept(arguments_.keep_largest, arguments_.drop_below.value_or(0));
  if (arguments_.keep_largest) {
    const bool is_cut = (query_.box || !query_.region.isEverywhere()) && !query_.cap;
    result_.ranked_by = is_cut || result_.missing_voxels > 0 ? "area" : "volume";
  }
  result_.components_seconds = watch_.seconds();
}

TriangleSink& ExtractedSurface::meshSink(bool to_file) {
  if (to_file && file_sink_ == nullptr && !result_.output.empty())
    file_sink_ = makeMeshFileSink(result_.output, fileOptionsOf(arguments_, pyramid_, attributes_));
  to_file_ = to_file && file_sink_ != nullptr;
  counting_sink_ = CountingSink();
  TriangleSink* sink = to_file_ ? static_cast<TriangleSink*>(file_sink_.get()) : &counting_sink_;
  if (arguments_.check) sink = &check_.emplace(*sink);
  TriangleSink& whole = measured(*sink);
  if (!result_.components) return whole;
  filter_.emplace(*result_.components, result_.is_kept, whole);
  return *filter_;
}

void ExtractedSurface::endMesh(const ExtractionReport& report) {
  const double seconds = watch_.seconds();
  result_.report = report;
  if (to_file_) result_.write_seconds = measured_->seconds(arguments_.query.threads);
  result_.extract_seconds.push_back(std::max(0.0, seconds - result_.write_seconds));
  if (check_) result_.quality = check_->quality();
  result_.vertices = to_file_ ? file_sink_->vertices() : counting_sink_.vertices();
}

ExtractResult ExtractedSurface::end(const std::function<ValueRange()>& range_of) {
  result_.simplify = query_.simplify;
  DetailChoice finest;
  finest.uniform_level = query_.uniform_level;
  result_.is_finest =
      query_.uniform_level.value_or(0) == 0 && static_cast<const DetailChoice&>(query_) == finest;
  if (file_sink_ != nullptr) {
    if (const std::string loss = file_sink_->loss(); !loss.empty())
      warnOfLosses(result_.output, {loss + "; give --shift auto, or write .ply"});
    if (const std::string assumption = file_sink_->assumption(); !assumption.empty())
      warnOfLosses(result_.output, {assumption});
  }
  for (std::size_t i = 0; i < attributes_.sampled.size(); ++i) {
    const PyramidValues* const values = attributes_.sampled[i];
    result_.vertices_outside.push_back(values != nullptr ? values->outside() - outside_before_[i]
                                                         : 0);
  }
  if (result_.report.triangles == 0 &&
      !warnOfEmptySurface(arguments_.query.input, isovalue_, pyramid_, range_of()) &&
      !arguments_.part)
    warnOfEmptyChoice(arguments_, result_);
  warnOfVerticesOutside(arguments_.attributes, attributes_, result_.vertices_outside,
                        result_.vertices, result_.output);
  return std::move(result_);
}

}  // namespace isobrick
