% SPDX-License-Identifier: MIT
function follow_pose (endpoint)
  % Prints the poses of all probes for ten seconds: follow_pose [ENDPOINT].
  if nargin < 1, endpoint = 'tcp/127.0.0.1:7447'; end
  poses = popen (['imud listen --json --seconds 10 --connect ' endpoint], 'r');
  line = fgetl (poses);
  while ischar (line)
    pose = jsondecode (line); % docs/pose.md has its fields
    printf ('%s %.6f %.6f %.6f %.6f\n', pose.probe, pose.q);
    line = fgetl (poses);
  end
  if pclose (poses) ~= 0, error ('imud listen failed'); end
end
