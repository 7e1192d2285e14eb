// The smallest host that renders one window by one plug-in, with pixels of raw float files; for tests.
// PLUGIN FOLDER WIDTH HEIGHT X1 Y1 X2 Y2 SCALE ABORT [NAME=NUMBER ...]; rows from the bottom. Images are cut to the
// region that the plug-in asks for. In FOLDER: Source, Z, maybe Mask, all RGBA; it writes result.
#include <dlfcn.h>

#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include "ofxCore.h"
#include "ofxImageEffect.h"
#include "ofxMessage.h"
#include "ofxParam.h"
#include "ofxProperty.h"

struct Set {
  std::map<std::string, std::map<int, double>> numbers;
  std::map<std::string, std::map<int, std::string>> texts;
  std::map<std::string, void *> pointers;
  std::vector<float> pixels;
};
static std::map<std::string, Set> clips;
static std::map<std::string, double> values;
static std::map<std::string, std::string> kinds;
static Set effect_set;
static int width, height, aborts_after, asked;
static double scale;
static double roi[4];

static Set *of(OfxPropertySetHandle h) { return reinterpret_cast<Set *>(h); }
static OfxPropertySetHandle as(Set *s) { return reinterpret_cast<OfxPropertySetHandle>(s); }

static OfxStatus set_text(OfxPropertySetHandle h, const char *n, int i, const char *v) { of(h)->texts[n][i] = v; return kOfxStatOK; }
static OfxStatus set_int(OfxPropertySetHandle h, const char *n, int i, int v) { of(h)->numbers[n][i] = v; return kOfxStatOK; }
static OfxStatus set_double(OfxPropertySetHandle h, const char *n, int i, double v) { of(h)->numbers[n][i] = v; return kOfxStatOK; }
static OfxStatus set_doubles(OfxPropertySetHandle h, const char *n, int c, const double *v) {
  for (int i = 0; i < c; ++i) of(h)->numbers[n][i] = v[i];
  return kOfxStatOK;
}
static OfxStatus get_int(OfxPropertySetHandle h, const char *n, int i, int *v) {
  if (!of(h)->numbers.count(n)) return kOfxStatErrUnknown;
  *v = static_cast<int>(of(h)->numbers[n][i]);
  return kOfxStatOK;
}
static OfxStatus get_double(OfxPropertySetHandle h, const char *n, int i, double *v) {
  if (!of(h)->numbers.count(n)) return kOfxStatErrUnknown;
  *v = of(h)->numbers[n][i];
  return kOfxStatOK;
}
static OfxStatus get_text(OfxPropertySetHandle h, const char *n, int i, char **v) { *v = of(h)->texts[n][i].data(); return kOfxStatOK; }
static OfxStatus get_pointer(OfxPropertySetHandle h, const char *n, int, void **v) { *v = of(h)->pointers[n]; return kOfxStatOK; }
static OfxStatus get_ints(OfxPropertySetHandle h, const char *n, int c, int *v) {
  for (int i = 0; i < c; ++i) v[i] = static_cast<int>(of(h)->numbers[n][i]);
  return kOfxStatOK;
}
static OfxStatus get_doubles(OfxPropertySetHandle h, const char *n, int c, double *v) {
  for (int i = 0; i < c; ++i) v[i] = of(h)->numbers[n][i];
  return kOfxStatOK;
}

static OfxStatus effect_properties(OfxImageEffectHandle, OfxPropertySetHandle *h) { *h = as(&effect_set); return kOfxStatOK; }
static OfxStatus effect_parameters(OfxImageEffectHandle, OfxParamSetHandle *h) { *h = nullptr; return kOfxStatOK; }
static OfxStatus clip_define(OfxImageEffectHandle, const char *n, OfxPropertySetHandle *h) { *h = as(&clips[n]); return kOfxStatOK; }
static OfxStatus clip_handle(OfxImageEffectHandle, const char *n, OfxImageClipHandle *c, OfxPropertySetHandle *h) {
  *c = reinterpret_cast<OfxImageClipHandle>(&clips[n]);
  if (h) *h = as(&clips[n]);
  return kOfxStatOK;
}
static OfxStatus clip_image(OfxImageClipHandle c, OfxTime, const OfxRectD *, OfxPropertySetHandle *h) {
  Set *clip = reinterpret_cast<Set *>(c), *image = new Set;
  int b[4] = {0, 0, width, height};
  if (clip != &clips["Output"])  // what was asked for and no more, as hosts with tiles give it
    for (int i = 0; i < 4; ++i) {
      const double edge = roi[i] * scale;
      b[i] = i < 2 ? std::max(0, static_cast<int>(std::floor(edge))) : std::min(i == 2 ? width : height, static_cast<int>(std::ceil(edge)));
    }
  for (int i = 0; i < 4; ++i) image->numbers[kOfxImagePropBounds][i] = b[i];
  image->numbers[kOfxImagePropRowBytes][0] = width * 16;
  image->numbers[kOfxImagePropPixelAspectRatio][0] = 1;
  image->texts[kOfxImageEffectPropPixelDepth][0] = kOfxBitDepthFloat;
  image->texts[kOfxImageEffectPropComponents][0] = kOfxImageComponentRGBA;
  image->pointers[kOfxImagePropData] = clip->pixels.data() + 4 * (static_cast<long>(b[1]) * width + b[0]);
  *h = as(image);
  return kOfxStatOK;
}
static OfxStatus clip_release(OfxPropertySetHandle h) { delete of(h); return kOfxStatOK; }
static OfxStatus clip_region(OfxImageClipHandle, OfxTime, OfxRectD *r) { *r = {0, 0, width / scale, height / scale}; return kOfxStatOK; }
static int wants_abort(OfxImageEffectHandle) { return aborts_after >= 0 && ++asked > aborts_after; }

static OfxStatus param_define(OfxParamSetHandle, const char *type, const char *n, OfxPropertySetHandle *h) {
  static std::map<std::string, Set> sets;
  kinds[n] = type;
  if (h) *h = as(&sets[n]);
  return kOfxStatOK;
}
static OfxStatus param_handle(OfxParamSetHandle, const char *n, OfxParamHandle *h, OfxPropertySetHandle *) {
  const auto found = kinds.find(n);
  if (found == kinds.end() || !values.count(n)) return kOfxStatErrUnknown;
  *h = reinterpret_cast<OfxParamHandle>(const_cast<std::string *>(&found->first));
  return kOfxStatOK;
}
static OfxStatus param_value_at(OfxParamHandle h, OfxTime time, ...) {
  const std::string &n = *reinterpret_cast<std::string *>(h);
  va_list all;
  va_start(all, time);
  if (kinds[n] == kOfxParamTypeDouble) *va_arg(all, double *) = values[n];
  else *va_arg(all, int *) = static_cast<int>(values[n]);
  va_end(all);
  return kOfxStatOK;
}
static OfxStatus message(void *, const char *type, const char *, const char *format, ...) {
  va_list all;
  va_start(all, format);
  std::printf("%s ", type);
  std::vprintf(format, all);
  std::printf("\n");
  va_end(all);
  return kOfxStatOK;
}

static OfxPropertySuiteV1 property_suite{};
static OfxImageEffectSuiteV1 effect_suite{};
static OfxParameterSuiteV1 parameter_suite{};
static OfxMessageSuiteV1 message_suite{};
static const void *fetch(OfxPropertySetHandle, const char *name, int) {
  const std::string n = name;
  if (n == kOfxPropertySuite) return &property_suite;
  if (n == kOfxImageEffectSuite) return &effect_suite;
  if (n == kOfxParameterSuite) return &parameter_suite;
  if (n == kOfxMessageSuite) return &message_suite;
  return nullptr;
}

int main(int, char **word) {
  property_suite.propSetString = set_text; property_suite.propSetInt = set_int; property_suite.propSetDouble = set_double;
  property_suite.propSetDoubleN = set_doubles; property_suite.propGetInt = get_int; property_suite.propGetDouble = get_double;
  property_suite.propGetString = get_text; property_suite.propGetPointer = get_pointer; property_suite.propGetIntN = get_ints;
  property_suite.propGetDoubleN = get_doubles;
  effect_suite.getPropertySet = effect_properties; effect_suite.getParamSet = effect_parameters;
  effect_suite.clipDefine = clip_define; effect_suite.clipGetHandle = clip_handle; effect_suite.clipGetImage = clip_image;
  effect_suite.clipReleaseImage = clip_release; effect_suite.clipGetRegionOfDefinition = clip_region; effect_suite.abort = wants_abort;
  parameter_suite.paramDefine = param_define; parameter_suite.paramGetHandle = param_handle;
  parameter_suite.paramGetValueAtTime = param_value_at;
  message_suite.message = message;
  const std::string folder = word[2];
  width = std::atoi(word[3]); height = std::atoi(word[4]);
  scale = std::atof(word[9]); aborts_after = std::atoi(word[10]);
  for (char **each = word + 11; *each != nullptr; ++each) {
    const std::string text = *each;
    values[text.substr(0, text.find('='))] = std::atof(text.c_str() + text.find('=') + 1);
  }
  for (const char *name : {"Source", "Z", "Mask"}) {
    std::ifstream file(folder + "/" + name, std::ios::binary);
    clips[name].numbers[kOfxImageClipPropConnected][0] = file.good();
    clips[name].pixels.resize(static_cast<std::size_t>(width) * height * 4);
    file.read(reinterpret_cast<char *>(clips[name].pixels.data()), clips[name].pixels.size() * 4);
  }
  clips["Output"].numbers[kOfxImageClipPropConnected][0] = 1;
  clips["Output"].pixels.assign(static_cast<std::size_t>(width) * height * 4, -1.0f);

  void *library = dlopen(word[1], RTLD_NOW);
  if (library == nullptr) { std::cerr << dlerror() << "\n"; return 2; }
  OfxPlugin *plugin = reinterpret_cast<OfxPlugin *(*)(int)>(dlsym(library, "OfxGetPlugin"))(0);
  OfxHost host{nullptr, fetch};
  Set in, out;
  plugin->setHost(&host);
  OfxStatus status = plugin->mainEntry(kOfxActionLoad, nullptr, nullptr, nullptr);
  if (status == kOfxStatOK) status = plugin->mainEntry(kOfxActionDescribe, &effect_set, nullptr, nullptr);
  if (status == kOfxStatOK) status = plugin->mainEntry(kOfxImageEffectActionDescribeInContext, &effect_set, nullptr, nullptr);
  for (int i = 0; i < 4; ++i) {
    in.numbers[kOfxImageEffectPropRenderWindow][i] = std::atoi(word[5 + i]);
    in.numbers[kOfxImageEffectPropRegionOfInterest][i] = std::atoi(word[5 + i]) / scale;
  }
  in.numbers[kOfxPropTime][0] = 0;
  in.numbers[kOfxImageEffectPropRenderScale][0] = in.numbers[kOfxImageEffectPropRenderScale][1] = scale;
  plugin->mainEntry(kOfxImageEffectActionGetRegionsOfInterest, &effect_set, as(&in), as(&out));
  for (int i = 0; i < 4; ++i) roi[i] = out.numbers["OfxImageClipPropRoI_Source"][i];
  std::printf("identity %d\n", plugin->mainEntry(kOfxImageEffectActionIsIdentity, &effect_set, as(&in), as(&out)) == kOfxStatOK);
  if (status == kOfxStatOK) status = plugin->mainEntry(kOfxImageEffectActionRender, &effect_set, as(&in), nullptr);
  std::printf("status %d\n", status);
  std::ofstream(folder + "/result", std::ios::binary)
      .write(reinterpret_cast<char *>(clips["Output"].pixels.data()), clips["Output"].pixels.size() * 4);
  return 0;
}
