// From voxels to nodes of the table.
float node(float voxel) {
  float at = (voxel - job.nodes.x) * job.nodes.y;
  return at > 0.0 ? min(at, job.nodes.z) : 0.0; // NaN goes to node 0
}
