// Shading of a segment with the gradients at its two ends (equations: shading.h).
vec4 shade(vec4 segment, vec3 front, vec3 back, vec3 eye) {
  precise vec3 sum = front + back;
  precise vec3 n = vec3(dot(job.shade.gradient[0].xyz, sum), dot(job.shade.gradient[1].xyz, sum), dot(job.shade.gradient[2].xyz, sum));
  precise float size = sqrt(dot(n, n));
  precise float inverse = 1.0 / max(size, 1e-18);
  precise float x = clamp((size - job.shade.low) / (1.0 - job.shade.low), 0.0, 1.0);
  precise float weight = x * x * (3.0 - x - x);
  precise float facing = dot(n, eye) * inverse;
  precise float lit = abs(facing);
  precise float mirror = lit;
  if (job.shade.head_light == 0) {
    precise vec3 middle = eye + job.shade.light;
    float towards = facing < 0.0 ? -inverse : inverse;
    lit = towards * dot(n, job.shade.light);
    mirror = towards * dot(n, middle / max(length(middle), 1e-20));
  }
  precise float glint = 0.0;
  if (job.shade.specular > 0.0 && lit > 0.0)
    glint = job.shade.specular * exp2(job.shade.shininess * log2(clamp(mirror, job.shade.least_mirror, 1.0)));
  float q = max(lit, job.shade.least);
  precise float factor = fma(weight, fma(job.shade.factor.y, q, job.shade.factor.x) - 1.0, 1.0);
  precise vec3 glow = fma(job.shade.glow[1].xyz, vec3(q), job.shade.glow[0].xyz) + glint;
  precise vec3 color = fma(vec3(weight * segment.a), glow, segment.rgb * factor);
  return vec4(clamp(color, vec3(0.0), vec3(segment.a)), segment.a);
}
