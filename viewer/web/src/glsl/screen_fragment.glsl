// The picture to a screen: linear light to sRGB.
precision highp float;
uniform sampler2D picture;
out vec4 color;
void main() {
  vec3 light = clamp(texelFetch(picture, ivec2(gl_FragCoord.xy), 0).rgb, 0.0, 1.0);
  vec3 high = 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055;
  color = vec4(mix(high, 12.92 * light, lessThanEqual(light, vec3(0.0031308))), 1.0);
}
