// OpenFX plug-in: bokeh from RGBA, a depth clip and an optional mask, rendered by a separate bokehnet process.
// Parameter names, and the conversion of depth to blur, are those of Nuke's ZDefocus.

#include <algorithm>
#include <cmath>
#include <cstring>
#include <sstream>
#include <string>
#include <vector>

#include "ofxCore.h"
#include "ofxImageEffect.h"
#include "ofxMessage.h"
#include "ofxParam.h"
#include "ofxProgress.h"
#include "ofxProperty.h"
#include "warm.h"

namespace {

OfxHost *host = nullptr;
const OfxPropertySuiteV1 *properties = nullptr;
const OfxImageEffectSuiteV1 *effects = nullptr;
const OfxParameterSuiteV1 *parameters = nullptr;
const OfxMessageSuiteV1 *messages = nullptr;    // may be missing
const OfxProgressSuiteV1 *progresses = nullptr;  // may be missing

enum Math { depth, far_zero, direct };

struct Number {
  const char *name, *label, *hint;
  double initial, low, high;
};
const Number kNumbers[] = {
    {"center", "focus plane", "Value of the depth channel in focus", 1, -1e9, 1e9},
    {"size", "size", "Blur radius at infinity, in pixels at full resolution", 10, 0, 1000},
    {"max_size", "maximum", "Maximum blur radius, in pixels at full resolution", 40, 0, 1000},
    {"roundness", "roundness", "Roundness of blades: 0 straight to 1 round", 0, 0, 1},
    {"rotation", "rotation", "Rotation of blades, degrees counter-clockwise", 0, -360, 360},
    {"aspect", "aspect", "Width of the blur disc over its height", 1, 0.1, 10},
    {"cats_eye", "cat's-eye", "Clipping of blur discs towards the corners", 0, 0, 1.5},
};

struct Choice {
  const char *name, *label, *hint;
  std::vector<const char *> options;
  int initial;
};
const Choice kChoices[] = {
    {"math", "math", "Content of the depth channel: distance, 1/distance, or blur radius in pixels",
     {"depth", "far=0", "direct"}, depth},
    {"filter_type", "filter type", "Shape of the aperture", {"disc", "bladed"}, 0},
    {"engine", "engine", "rays handles occlusion at depth edges; scatter is faster", {"rays", "scatter"}, 0},
};
const int kBlades = 5;

double number(OfxParamSetHandle set, const char *name, OfxTime time) {
  OfxParamHandle handle;
  double value;
  for (const Number &each : kNumbers) {
    if (std::strcmp(each.name, name) != 0) continue;
    if (parameters->paramGetHandle(set, name, &handle, nullptr) == kOfxStatOK &&
        parameters->paramGetValueAtTime(handle, time, &value) == kOfxStatOK)
      return std::clamp(value, each.low, each.high);  // hosts need not clamp
    return each.initial;  // the host does not have the parameter
  }
  return 0;
}

int integer(OfxParamSetHandle set, const char *name, OfxTime time, int fallback) {
  OfxParamHandle handle;
  int value;
  const bool available = parameters->paramGetHandle(set, name, &handle, nullptr) == kOfxStatOK &&
                         parameters->paramGetValueAtTime(handle, time, &value) == kOfxStatOK;
  return available ? value : fallback;
}

int choice(OfxParamSetHandle set, const char *name, OfxTime time) {
  for (const Choice &each : kChoices)
    if (std::strcmp(each.name, name) == 0) {
      const int option = integer(set, name, time, each.initial);
      return option >= 0 && option < static_cast<int>(each.options.size()) ? option : each.initial;
    }
  return 0;
}

// An image borrowed from the host; released by the destructor.
class Image {
 public:
  Image(OfxImageEffectHandle effect, const char *clip, OfxTime time) {
    OfxImageClipHandle handle;
    OfxPropertySetHandle clip_properties;
    int connected = 0;
    if (effects->clipGetHandle(effect, clip, &handle, &clip_properties) != kOfxStatOK) return;
    if (properties->propGetInt(clip_properties, kOfxImageClipPropConnected, 0, &connected) != kOfxStatOK) connected = 1;
    if (!connected || effects->clipGetImage(handle, time, nullptr, &image_) != kOfxStatOK) {
      image_ = nullptr;
      return;
    }
    properties->propGetPointer(image_, kOfxImagePropData, 0, &data_);
    properties->propGetIntN(image_, kOfxImagePropBounds, 4, &bounds.x1);
    properties->propGetInt(image_, kOfxImagePropRowBytes, 0, &row_bytes_);
    properties->propGetDouble(image_, kOfxImagePropPixelAspectRatio, 0, &aspect);
    char *text = nullptr;
    properties->propGetString(image_, kOfxImageEffectPropPixelDepth, 0, &text);
    const std::string bits = text == nullptr ? "" : text;
    bytes_ = bits == kOfxBitDepthByte ? 1 : bits == kOfxBitDepthShort ? 2 : bits == kOfxBitDepthFloat ? 4 : 0;
    properties->propGetString(image_, kOfxImageEffectPropComponents, 0, &text);
    const std::string kind = text == nullptr ? "" : text;
    channels_ = kind == kOfxImageComponentRGBA ? 4 : kind == kOfxImageComponentRGB ? 3 : kind == kOfxImageComponentAlpha ? 1 : 0;
  }
  ~Image() {
    if (image_ != nullptr) effects->clipReleaseImage(image_);
  }
  Image(const Image &) = delete;
  Image &operator=(const Image &) = delete;

  bool available() const { return image_ != nullptr && data_ != nullptr && bytes_ != 0 && channels_ != 0; }
  int channels() const { return channels_; }

  float get(int x, int y, int channel) const {
    const char *at = address(x, y, channel);
    if (bytes_ == 1) return static_cast<float>(*reinterpret_cast<const unsigned char *>(at)) / 255.0f;
    if (bytes_ == 2) return static_cast<float>(*reinterpret_cast<const unsigned short *>(at)) / 65535.0f;
    return *reinterpret_cast<const float *>(at);
  }
  void set(int x, int y, int channel, float value) {
    char *at = address(x, y, channel);
    const float max_value = bytes_ == 1 ? 255.0f : 65535.0f;
    const float scaled = std::clamp(value, 0.0f, 1.0f) * max_value + 0.5f;
    if (bytes_ == 1) *reinterpret_cast<unsigned char *>(at) = static_cast<unsigned char>(scaled);
    else if (bytes_ == 2) *reinterpret_cast<unsigned short *>(at) = static_cast<unsigned short>(scaled);
    else *reinterpret_cast<float *>(at) = value;
  }
  bool covers(int x, int y) const { return x >= bounds.x1 && x < bounds.x2 && y >= bounds.y1 && y < bounds.y2; }

  OfxRectI bounds{0, 0, 0, 0};
  double aspect = 1;

 private:
  char *address(int x, int y, int channel) const {
    const std::ptrdiff_t row = static_cast<std::ptrdiff_t>(y - bounds.y1) * row_bytes_;
    const std::ptrdiff_t column = static_cast<std::ptrdiff_t>((x - bounds.x1) * channels_ + channel) * bytes_;
    return static_cast<char *>(data_) + row + column;
  }
  OfxPropertySetHandle image_ = nullptr;
  void *data_ = nullptr;
  int row_bytes_ = 0, bytes_ = 0, channels_ = 0;
};

OfxRectI intersection(const OfxRectI &a, const OfxRectI &b) {
  return {std::max(a.x1, b.x1), std::max(a.y1, b.y1), std::min(a.x2, b.x2), std::min(a.y2, b.y2)};
}

// Signed blur radius in pixels at full resolution, positive in front of focus. Potmesil and Chakravarty, 1981, scaled by
// the radius at infinity: size * (center / z - 1).
float radius(Math math, float value, double center, double size, double max_radius) {
  double result;
  if (math == direct) result = value;
  else if (math == depth) result = value > 0 ? size * (center / value - 1) : max_radius;
  else result = center != 0 ? size * (value / center - 1) : size * value;
  return static_cast<float>(std::isnan(result) ? 0.0 : std::clamp(result, -max_radius, max_radius));
}

OfxStatus fail(OfxImageEffectHandle effect, const std::string &text) {
  if (messages != nullptr) messages->message(effect, kOfxMessageError, "bokehnet", "%s", text.c_str());
  return kOfxStatFailed;
}

OfxParamSetHandle parameters_of(OfxImageEffectHandle effect) {
  OfxParamSetHandle set = nullptr;
  effects->getParamSet(effect, &set);
  return set;
}

std::string settings(OfxParamSetHandle set, OfxTime time, double pixel_aspect) {
  std::ostringstream text;
  text.imbue(std::locale::classic());
  text << "\"settings\": {\"engine\": {\"name\": \"" << kChoices[2].options[choice(set, "engine", time)] << "\"}, ";
  text << "\"aperture\": {\"cats_eye\": " << number(set, "cats_eye", time);
  if (choice(set, "filter_type", time) == 1)
    text << ", \"blades\": " << std::clamp(integer(set, "blades", time, kBlades), 3, 16)
         << ", \"curvature\": " << number(set, "roundness", time) << ", \"rotation\": " << number(set, "rotation", time);
  const double squeeze = std::clamp(number(set, "aspect", time) / pixel_aspect, 0.1, 10.0);
  text << ", \"squeeze\": " << squeeze << "}}";
  return text.str();
}

OfxStatus render(OfxImageEffectHandle effect, OfxPropertySetHandle in) {
  OfxTime time;
  OfxRectI window;
  double scale[2] = {1, 1};
  properties->propGetDouble(in, kOfxPropTime, 0, &time);
  properties->propGetIntN(in, kOfxImageEffectPropRenderWindow, 4, &window.x1);
  properties->propGetDoubleN(in, kOfxImageEffectPropRenderScale, 2, scale);
  Image source(effect, "Source", time), map(effect, "Z", time), mask(effect, "Mask", time), output(effect, "Output", time);
  if (!source.available() || source.channels() != 4 || !output.available() || output.channels() != 4)
    return fail(effect, "Source: expected RGBA of 8, 16 or 32 bits, found another kind; convert it");
  if (!map.available()) return fail(effect, "Z: expected a clip with the depth, found none; connect one");

  const OfxParamSetHandle set = parameters_of(effect);
  const double size = number(set, "size", time), max_size = number(set, "max_size", time), center = number(set, "center", time);
  const Math math = static_cast<Math>(choice(set, "math", time));
  if (math == depth && center <= 0) return fail(effect, "center: expected a distance above 0 with math depth; set it");
  const int margin = static_cast<int>(std::ceil(max_size * scale[0])) + 1;
  OfxRectI padded{window.x1 - margin, window.y1 - margin, window.x2 + margin, window.y2 + margin};
  const OfxRectI part = intersection(intersection(padded, source.bounds), map.bounds);
  const int width = part.x2 - part.x1, height = part.y2 - part.y1;
  if (width <= 0 || height <= 0) return fail(effect, "Z: expected depth where the picture is, found none there");

  const std::size_t count = static_cast<std::size_t>(width) * height, colors = 16 * count;
  try {
    bokehnet::SharedMemory shared(2 * colors + 4 * count);
    float *picture = shared.at(0), *blur = shared.at(colors), *result = shared.at(colors + 4 * count);
    const int depth_channel = 0;
    for (int row = 0; row < height; ++row) {  // hosts count rows from the bottom
      const int y = part.y2 - 1 - row;
      for (int column = 0; column < width; ++column) {
        const int x = part.x1 + column;
        for (int channel = 0; channel < 4; ++channel) *picture++ = source.get(x, y, channel);
        *blur++ = radius(math, map.get(x, y, depth_channel), center, size, max_size) * static_cast<float>(scale[0]);
      }
    }
    OfxImageClipHandle clip;
    OfxRectD all{0, 0, 0, 0};
    effects->clipGetHandle(effect, "Source", &clip, nullptr);
    if (effects->clipGetRegionOfDefinition(clip, time, &all) != kOfxStatOK || all.x2 <= all.x1)
      all = {part.x1 / scale[0], part.y1 / scale[1], part.x2 / scale[0], part.y2 / scale[1]};
    const double aspect = source.aspect > 0 ? source.aspect : 1;
    const int left = static_cast<int>(std::floor(all.x1 * scale[0] / aspect + 0.5));
    const int right = static_cast<int>(std::floor(all.x2 * scale[0] / aspect + 0.5));
    const int bottom = static_cast<int>(std::floor(all.y1 * scale[1] + 0.5));
    const int top = static_cast<int>(std::floor(all.y2 * scale[1] + 0.5));
    std::ostringstream text;
    text.imbue(std::locale::classic());
    text << settings(set, time, aspect) << ", \"pixels\": {\"file\": \"" << shared.path() << "\", \"width\": " << width
         << ", \"height\": " << height << ", \"image\": 0, \"depth\": " << colors << ", \"result\": " << colors + 4 * count
         << ", \"kind\": \"defocus\", \"x\": " << part.x1 - left << ", \"y\": " << top - part.y2
         << ", \"display_width\": " << right - left << ", \"display_height\": " << top - bottom << "}";

    if (progresses != nullptr) progresses->progressStart(effect, "bokehnet");
    bool stopped = false;
    std::string message;
    const auto report = [&](double fraction) {
      if (progresses != nullptr && progresses->progressUpdate(effect, fraction) == kOfxStatReplyNo) stopped = true;
    };
    const auto is_cancelled = [&] { return stopped || effects->abort(effect) != 0; };
    const bokehnet::Outcome outcome = bokehnet::request(text.str(), report, is_cancelled, message);
    if (progresses != nullptr) progresses->progressEnd(effect);
    if (outcome == bokehnet::Outcome::failed) return fail(effect, message);
    if (outcome == bokehnet::Outcome::cancelled) return kOfxStatOK;  // the host discards the picture

    const OfxRectI target = intersection(window, output.bounds);
    for (int y = target.y1; y < target.y2; ++y)
      for (int x = target.x1; x < target.x2; ++x) {
        const bool inside = x >= part.x1 && x < part.x2 && y >= part.y1 && y < part.y2;
        const float weight = !mask.available() ? 1 : mask.covers(x, y) ? mask.get(x, y, mask.channels() - 1) : 0;
        for (int channel = 0; channel < 4; ++channel) {
          const float before = source.covers(x, y) ? source.get(x, y, channel) : 0;
          const std::size_t index = (static_cast<std::size_t>(part.y2 - 1 - y) * width + (x - part.x1)) * 4 + channel;
          const float after = inside ? result[index] : before;
          output.set(x, y, channel, before + weight * (after - before));
        }
      }
    return kOfxStatOK;
  } catch (const std::exception &error) {
    return fail(effect, error.what());
  }
}

// Set the input regions needed for a region of the result: it is extended by the largest blur radius.
OfxStatus regions(OfxImageEffectHandle effect, OfxPropertySetHandle in, OfxPropertySetHandle out) {
  OfxTime time;
  OfxRectD requested;
  properties->propGetDouble(in, kOfxPropTime, 0, &time);
  properties->propGetDoubleN(in, kOfxImageEffectPropRegionOfInterest, 4, &requested.x1);
  const double margin = 2 * (number(parameters_of(effect), "max_size", time) + 1);  // pixels may be twice as wide as high
  double region[4] = {requested.x1 - margin, requested.y1 - margin, requested.x2 + margin, requested.y2 + margin};
  for (const char *name : {"OfxImageClipPropRoI_Source", "OfxImageClipPropRoI_Z", "OfxImageClipPropRoI_Mask"})
    properties->propSetDoubleN(out, name, 4, region);
  return kOfxStatOK;
}

OfxStatus identity(OfxImageEffectHandle effect, OfxPropertySetHandle in, OfxPropertySetHandle out) {
  OfxTime time;
  properties->propGetDouble(in, kOfxPropTime, 0, &time);
  const OfxParamSetHandle set = parameters_of(effect);
  const bool sharp = number(set, "max_size", time) == 0 ||
                     (choice(set, "math", time) != direct && number(set, "size", time) == 0);
  if (!sharp) return kOfxStatReplyDefault;
  properties->propSetString(out, kOfxPropName, 0, "Source");
  properties->propSetDouble(out, kOfxPropTime, 0, time);
  return kOfxStatOK;
}

OfxStatus describe(OfxImageEffectHandle effect) {
  OfxPropertySetHandle all;
  effects->getPropertySet(effect, &all);
  properties->propSetString(all, kOfxPropLabel, 0, "bokehnet");
  properties->propSetString(all, kOfxImageEffectPluginPropGrouping, 0, "Filter");
  properties->propSetString(all, kOfxImageEffectPropSupportedContexts, 0, kOfxImageEffectContextFilter);
  properties->propSetString(all, kOfxImageEffectPropSupportedContexts, 1, kOfxImageEffectContextGeneral);
  int index = 0;
  for (const char *bits : {kOfxBitDepthFloat, kOfxBitDepthShort, kOfxBitDepthByte})
    properties->propSetString(all, kOfxImageEffectPropSupportedPixelDepths, index++, bits);
  properties->propSetInt(all, kOfxImageEffectPropSupportsTiles, 0, 1);
  properties->propSetInt(all, kOfxImageEffectPropSupportsMultiResolution, 0, 1);
  properties->propSetString(all, kOfxImageEffectPluginRenderThreadSafety, 0, kOfxImageEffectRenderFullySafe);
  return kOfxStatOK;
}

OfxStatus describe_in_context(OfxImageEffectHandle effect) {
  OfxPropertySetHandle clip;
  for (const char *name : {"Source", "Z", "Mask", "Output"}) {
    effects->clipDefine(effect, name, &clip);
    properties->propSetString(clip, kOfxImageEffectPropSupportedComponents, 0, kOfxImageComponentRGBA);
    properties->propSetInt(clip, kOfxImageEffectPropSupportsTiles, 0, 1);
    if (std::strcmp(name, "Z") == 0 || std::strcmp(name, "Mask") == 0) {
      properties->propSetString(clip, kOfxImageEffectPropSupportedComponents, 1, kOfxImageComponentAlpha);
      properties->propSetInt(clip, kOfxImageClipPropOptional, 0, 1);
    }
    if (std::strcmp(name, "Mask") == 0) properties->propSetInt(clip, kOfxImageClipPropIsMask, 0, 1);
  }
  OfxParamSetHandle set = parameters_of(effect);
  OfxPropertySetHandle one;
  for (const Choice &each : kChoices) {
    parameters->paramDefine(set, kOfxParamTypeChoice, each.name, &one);
    properties->propSetString(one, kOfxPropLabel, 0, each.label);
    properties->propSetString(one, kOfxParamPropHint, 0, each.hint);
    for (std::size_t i = 0; i < each.options.size(); ++i)
      properties->propSetString(one, kOfxParamPropChoiceOption, static_cast<int>(i), each.options[i]);
    properties->propSetInt(one, kOfxParamPropDefault, 0, each.initial);
  }
  for (const Number &each : kNumbers) {
    parameters->paramDefine(set, kOfxParamTypeDouble, each.name, &one);
    properties->propSetString(one, kOfxPropLabel, 0, each.label);
    properties->propSetString(one, kOfxParamPropHint, 0, each.hint);
    properties->propSetDouble(one, kOfxParamPropDefault, 0, each.initial);
    properties->propSetDouble(one, kOfxParamPropMin, 0, each.low);
    properties->propSetDouble(one, kOfxParamPropMax, 0, each.high);
  }
  parameters->paramDefine(set, kOfxParamTypeInteger, "blades", &one);
  properties->propSetString(one, kOfxPropLabel, 0, "blades");
  properties->propSetInt(one, kOfxParamPropDefault, 0, kBlades);
  properties->propSetInt(one, kOfxParamPropMin, 0, 3);
  properties->propSetInt(one, kOfxParamPropMax, 0, 16);
  return kOfxStatOK;
}

OfxStatus load() {
  if (host == nullptr) return kOfxStatErrMissingHostFeature;
  const auto suite = [](const char *name) { return host->fetchSuite(host->host, name, 1); };
  properties = static_cast<const OfxPropertySuiteV1 *>(suite(kOfxPropertySuite));
  effects = static_cast<const OfxImageEffectSuiteV1 *>(suite(kOfxImageEffectSuite));
  parameters = static_cast<const OfxParameterSuiteV1 *>(suite(kOfxParameterSuite));
  messages = static_cast<const OfxMessageSuiteV1 *>(suite(kOfxMessageSuite));
  progresses = static_cast<const OfxProgressSuiteV1 *>(suite(kOfxProgressSuite));
  const bool complete = properties != nullptr && effects != nullptr && parameters != nullptr;
  return complete ? kOfxStatOK : kOfxStatErrMissingHostFeature;
}

OfxStatus dispatch(const char *action, const void *handle, OfxPropertySetHandle in, OfxPropertySetHandle out) {
  const OfxImageEffectHandle effect = static_cast<OfxImageEffectHandle>(const_cast<void *>(handle));
  const std::string name = action;
  if (name == kOfxActionLoad) return load();
  if (name == kOfxActionDescribe) return describe(effect);
  if (name == kOfxImageEffectActionDescribeInContext) return describe_in_context(effect);
  if (name == kOfxImageEffectActionRender) return render(effect, in);
  if (name == kOfxImageEffectActionIsIdentity) return identity(effect, in, out);
  if (name == kOfxImageEffectActionGetRegionsOfInterest) return regions(effect, in, out);
  return kOfxStatReplyDefault;
}

void set_host(OfxHost *new_host) { host = new_host; }

OfxPlugin plugin = {kOfxImageEffectPluginApi, 1, BOKEHNET_OFX_ID, 0, 1, set_host, dispatch};

}  // namespace

extern "C" {
__attribute__((visibility("default"))) OfxPlugin *OfxGetPlugin(int nth) { return nth == 0 ? &plugin : nullptr; }
__attribute__((visibility("default"))) int OfxGetNumberOfPlugins(void) { return 1; }
}
