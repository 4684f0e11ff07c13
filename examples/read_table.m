% SPDX-License-Identifier: MIT
function table = read_table (path)
  % A table of imud export --to csv as a struct, a column each: p = read_table (PATH).
  file = fopen (path);
  names = strsplit (fgetl (file), ',');
  words = {'time_utc', 'utc_host', 'flags', 'event', 'cause', 'end', 'state', 'port', ...
           'reason', 'log_state', 'twin_state', 'since_origin_void', ...
           'advice', 'text', 'command', 'by', 'id', 'unit', 'probe_id', ...
           'no_position', 'refused'};
  kinds = repmat ({'%f'}, 1, numel (names));
  kinds(ismember (names, words)) = {'%s'};
  columns = textscan (file, [kinds{:}], 'Delimiter', ',', 'EmptyValue', NaN);
  fclose (file);
  table = cell2struct (columns, names, 2);
end
